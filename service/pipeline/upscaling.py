"""The models as the service runs them: on views out of the renderer, with what the report says of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ciir.models import catalogue
from ciir.models.light_field.views import NEGLIGIBLE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.single.skip import Tally
    from ciir.models.upscaler import Upscaler
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.service.pipeline.plan import Plan

Enlarge = Callable[[Mapping["View", "Pixels"], Sequence["View"]], tuple["Pixels", float]]
"""From views `(H, W, C)` by (v, u), and which of them are wanted, to those `(n, scale*H, scale*W, C)`; and the share of
pixels that another model made, as the views around don't match."""


def opened(plan: Plan, grid: tuple[int, int], *, skipping: bool = True, tally: Tally | None = None) -> Enlarge:
    """What `plan.model`, one of the catalogue, makes of views of a light field of `grid` views. `skipping`: whether to
    leave out what needn't be computed, which is added to `tally`.

    Raises as `models.catalogue.load`.
    """
    if plan.is_light_field:
        from ciir.models.light_field.views import upscale_views

        network = catalogue.load_light_field(plan.model, scale=plan.enlarge)
        single = catalogue.load(catalogue.default(), scale=plan.enlarge)

        def together(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, float]:
            colours, opaque = _opaque(views)
            made, left = upscale_views(network, single, colours, wanted, grid, skipping=skipping, tally=tally)
            return np.concatenate([made, np.full_like(made[..., :1], opaque)], axis=3) if opaque else made, left

        return _timed(together, tally)
    upscaler = catalogue.load(plan.model, scale=plan.enlarge)

    def alone(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, float]:
        pictures: NDArray[Any] = np.stack([views[view] for view in wanted])
        return enlarge(upscaler, pictures, skipping=skipping, tally=tally), 0.0

    return _timed(alone, tally)


def _timed(run: Enlarge, tally: Tally | None) -> Enlarge:
    """`run`, whose time is added to `tally`."""
    if tally is None:
        return run

    def timed(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, float]:
        begun = time.perf_counter()
        made = run(views, wanted)
        tally.seconds += time.perf_counter() - begun
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


def enlarge(upscaler: Upscaler, pictures: Pixels, *, skipping: bool = True, tally: Tally | None = None) -> Pixels:
    """`models.upscale_pixels`: `(N, H, W, C)` to `(N, scale*H, scale*W, C)` of the same type."""
    from ciir.models.single.pixels import upscale_pixels

    # Its type variable takes 8 or 16 bit, where a picture that was read is either: one of them stands for both.
    return upscale_pixels(upscaler, cast("NDArray[np.uint8]", pictures), skipping=skipping, tally=tally)


def describe_model(name: str, scale: int) -> dict[str, Any]:
    """The report's `model`: name, scale, and the network's SHA-256 (null for interpolation); of a light-field network
    also `alone`, the model of single pictures that makes what the views around don't match.
    """
    entry = next(entry for entry in catalogue.entries() if entry.name == name)
    said = {"name": name, "scale": scale, "sha256": entry.card.sha256 if entry.card is not None else None}
    return said | {"alone": describe_model(catalogue.default(), scale)} if entry.is_light_field else said


def skipped(tally: Tally) -> dict[str, Any]:
    """The report's `skipped`: input pixels of the model, the share of them that it needn't see, by reason, and
    `saved_ms`, what those would have taken it at the others' pace, at most: what boxes see around them is not taken
    off; null where there are no others.
    """
    pixels = max(1, tally.pixels)
    shares = {"plain": tally.plain, "repeated": tally.repeated}
    left_out = sum(shares.values())
    left = tally.pixels - left_out
    saved = round(1000 * tally.seconds * left_out / left, 3) if left else None
    by_reason = {reason: round(count / pixels, 4) for reason, count in shares.items()}
    return {"pixels": tally.pixels} | by_reason | {"saved_ms": saved}


def unmatched(share: float) -> list[str]:
    """The report's note on `share` of all pixels that the views around were of no help for; none where it is small."""
    if share < NEGLIGIBLE:
        return []
    why = "another scene, noise, or depths too far apart"
    made = f"{100 * share:.0f} % of the pixels were made by {catalogue.default()} from their view alone"
    return [f"{made}, as the views around don't match there: {why}"]
