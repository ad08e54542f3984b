"""The models as the service runs them: on views out of the renderer, with what the report says of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ciir.models import catalogue
from ciir.models.light_field.views import MINIMUM_FALLBACK_SHARE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.single.skipping import SkipStatistics
    from ciir.models.upscaler import Upscaler
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.service.pipeline.plan import Plan

Enlarge = Callable[[Mapping["View", "Pixels"], Sequence["View"]], tuple["Pixels", float]]
"""From views `(H, W, C)` by (v, u), and which of them are wanted, to those `(n, scale*H, scale*W, C)`; and the share of
pixels that another model made, as the views around don't match."""


def opened(
    plan: Plan, grid: tuple[int, int], *, skip: bool = True, statistics: SkipStatistics | None = None
) -> Enlarge:
    """What `plan.model`, one of the catalogue, makes of views of a light field of `grid` views. `skip`: whether to
    leave out what needn't be computed, which is added to `statistics`.

    Raises as `models.catalogue.load_upscaler`.
    """
    if plan.is_light_field:
        from ciir.models.light_field.views import upscale_views

        network = catalogue.load_light_field_network(plan.model, scale=plan.enlarge)
        single = catalogue.load_upscaler(catalogue.default_name(), scale=plan.enlarge)

        def together(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, float]:
            colours, opaque = _opaque(views)
            made, left = upscale_views(network, single, colours, wanted, grid, skip=skip, statistics=statistics)
            return np.concatenate([made, np.full_like(made[..., :1], opaque)], axis=3) if opaque else made, left

        return _timed(together, statistics)
    upscaler = catalogue.load_upscaler(plan.model, scale=plan.enlarge)

    def alone(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, float]:
        pictures: NDArray[Any] = np.stack([views[view] for view in wanted])
        return enlarge(upscaler, pictures, skip=skip, statistics=statistics), 0.0

    return _timed(alone, statistics)


def _timed(run: Enlarge, statistics: SkipStatistics | None) -> Enlarge:
    """`run`, whose time is added to `statistics`."""
    if statistics is None:
        return run

    def timed(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, float]:
        begun = time.perf_counter()
        made = run(views, wanted)
        statistics.seconds += time.perf_counter() - begun
        return made

    return timed


def _opaque(views: Mapping[View, Pixels]) -> tuple[Mapping[View, Pixels], int]:
    """The grey or colours of opaque views, and what their alpha is; 0 where they have none.
    `service.pipeline.model_selection` sees to it
    that none is transparent.
    """
    first = next(iter(views.values()))
    if first.shape[2] in (1, 3):
        return views, 0
    return {view: picture[..., :-1] for view, picture in views.items()}, int(np.iinfo(first.dtype).max)


def enlarge(
    upscaler: Upscaler, pictures: Pixels, *, skip: bool = True, statistics: SkipStatistics | None = None
) -> Pixels:
    """`models.upscale_pixels`: `(N, H, W, C)` to `(N, scale*H, scale*W, C)` of the same type."""
    from ciir.models.single.pixels import upscale_pixels

    # Its type variable takes 8 or 16 bit, where a picture that was read is either: one of them stands for both.
    return upscale_pixels(upscaler, cast("NDArray[np.uint8]", pictures), skip=skip, statistics=statistics)


def describe_model(name: str, scale: int) -> dict[str, Any]:
    """The report's `model`: name, scale, and the network's SHA-256 (null for interpolation); of a light-field network
    also `fallback`, the single-image model that is used where the network's confidence is low.
    """
    entry = next(entry for entry in catalogue.list_entries() if entry.name == name)
    said = {"name": name, "scale": scale, "sha256": entry.card.sha256 if entry.card is not None else None}
    return said | {"fallback": describe_model(catalogue.default_name(), scale)} if entry.is_light_field else said


def skipped(statistics: SkipStatistics) -> dict[str, Any]:
    """The report's `skipped`: input pixels of the model, the share of them that it needn't see, by reason, and
    `saved_ms`, what those would have taken it at the others' pace, at most: what boxes see around them is not taken
    off; null where there are no others.
    """
    pixels = max(1, statistics.pixels)
    shares = {"uniform": statistics.uniform, "repeated": statistics.repeated}
    left_out = sum(shares.values())
    left = statistics.pixels - left_out
    saved = round(1000 * statistics.seconds * left_out / left, 3) if left else None
    by_reason = {reason: round(count / pixels, 4) for reason, count in shares.items()}
    return {"pixels": statistics.pixels} | by_reason | {"saved_ms": saved}


def unmatched(share: float) -> list[str]:
    """The report's note on `share` of all pixels that the views around were of no help for; none where it is small."""
    if share < MINIMUM_FALLBACK_SHARE:
        return []
    why = "another scene, noise, or depths too far apart"
    made = f"{100 * share:.0f} % of the pixels were made by {catalogue.default_name()} from their view alone"
    return [f"{made}, as the views around don't match there: {why}"]
