"""Upscales the renderer's views with the models, and describes the result for the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.bit_depth import count_unused_camera_bits, limit_levels
from ciir.cores import count_available_cores
from ciir.models import catalogue
from ciir.models.back_projection import restore_means
from ciir.models.light_field.finishing import MINIMUM_FALLBACK_SHARE, Finishing
from ciir.service.pipeline.report import format_percent
from ciir.service.pipeline.stages import moved_array

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.single.skipping import SkipStatistics
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.service.pipeline.planning.plan import Plan
    from ciir.service.pipeline.stages.arrangement import Arrangement

FetchViews = Callable[[Sequence["View"]], Sequence["Pixels"]]
"""Returns views `(H, W, C)` of a light field."""
UpscaleViews = Callable[[Mapping["View", "Pixels"], Sequence["View"]], tuple["Pixels", list["Finishing"]]]
"""Takes views `(H, W, C)` by (v, u), and which of them are wanted. Returns the upscaled ones `(n, scale*H, scale*W,
C)`, and how each was finished after a light-field network."""


def load_upscaler(
    plan: Plan,
    arrangement: Arrangement,
    *,
    fetch: FetchViews | None = None,
    skip: bool = True,
    statistics: SkipStatistics | None = None,
) -> UpscaleViews:
    """Loads `plan.model` for views of a light field.

    `fetch`: returns the views that fusion needs besides those that the result is called with. `skip`: whether pixels
    with a known result are skipped; they are counted in `statistics`. Colours stay within the bits of each view's
    camera (`ciir.bit_depth`), which interpolation would exceed at edges. Raises the same errors as
    `models.catalogue.load_upscaler`.
    """
    upscale = _load_model(plan, arrangement, fetch, skip, statistics)

    def upscale_within_bits(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, list[Finishing]]:
        made, finished = upscale(views, wanted)
        for picture, view in zip(made, wanted, strict=True):
            if plan.restores_means:
                picture[:] = restore_means(picture, views[view])
            limit_levels(picture, count_unused_camera_bits(views[view]))
        return made, finished

    return upscale_within_bits


def _load_model(
    plan: Plan, arrangement: Arrangement, fetch: FetchViews | None, skip: bool, statistics: SkipStatistics | None
) -> UpscaleViews:
    if plan.is_light_field:
        from ciir.models.light_field.fusion.views import FusingUpscaler, is_matched
        from ciir.models.light_field.views import upscale_views

        network = catalogue.load_light_field_network(plan.model, scale=plan.scale)
        fallback = catalogue.load_upscaler(catalogue.picture_default_name(), scale=plan.scale)
        upscale = partial(
            upscale_views,
            network,
            fallback,
            skip=skip,
            statistics=statistics,
            finds_sampling=plan.finds_sampling,
            disparities=moved_array.DISPARITIES if plan.moves_array else None,
        )

        def fetch_places(places: Sequence[View]) -> Mapping[View, Pixels]:
            assert fetch is not None  # noqa: S101 - views are fused only if there is a light field to fetch from
            colours, _ = _split_alpha(dict(zip(places, fetch(arrangement.find_views(places)), strict=True)))
            return colours

        fusing = FusingUpscaler(
            upscale,
            arrangement.grid,
            arrangement.stride,
            fusion=plan.fusion,
            matches=is_matched(plan.fusion, network.card.macs_per_output_pixel),
            is_jpeg=plan.is_jpeg,
            fetch=fetch_places,
            cores=count_available_cores(),
        )

        def upscale_light_field(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, list[Finishing]]:
            colours, alpha = _split_alpha(views)
            given = {arrangement.find_place(view): picture for view, picture in colours.items()}
            places = [arrangement.find_place(view) for view in wanted]
            made, finished = fusing(given, places)
            return np.concatenate([made, np.full_like(made[..., :1], alpha)], axis=3) if alpha else made, finished

        return upscale_light_field
    from ciir.models.single.finishing import average_misfit
    from ciir.models.single.pixels import upscale_pixels

    upscaler = catalogue.load_upscaler(plan.model, scale=plan.scale)

    def upscale_singly(views: Mapping[View, Pixels], wanted: Sequence[View]) -> tuple[Pixels, list[Finishing]]:
        pictures: NDArray[Any] = np.stack([views[view] for view in wanted])
        made = upscale_pixels(upscaler, pictures, skip=skip, statistics=statistics)
        if not plan.averages_misfits:
            return made, []
        return made, [Finishing(interpolated=share) for share in map(average_misfit, made, pictures)]

    return upscale_singly


def _split_alpha(views: Mapping[View, Pixels]) -> tuple[Mapping[View, Pixels], int]:
    """Splits opaque views into their grey or colours and their alpha, which is 0 if they have none.

    `model_selection` never passes a transparent view to a light-field network.
    """
    first = next(iter(views.values()))
    if first.shape[2] in (1, 3):
        return views, 0
    return {view: picture[..., :-1] for view, picture in views.items()}, int(np.iinfo(first.dtype).max)


def describe_model(name: str, scale: int) -> dict[str, Any]:
    """Returns the report's `model`: name, scale, and the network's SHA-256, null for interpolation.

    A light-field network also has `fallback`, the single-picture model that makes the pixels of low confidence.
    """
    entry = catalogue.get_entry(name)
    described = {"name": name, "scale": scale, "sha256": entry.card.sha256 if entry.card is not None else None}
    if not entry.is_light_field:
        return described
    return described | {"fallback": describe_model(catalogue.picture_default_name(), scale)}


def describe_skipped(statistics: SkipStatistics) -> dict[str, Any]:
    """Returns the report's `skipped`: the model's input pixels, and the share of them that it didn't compute."""
    return {"pixels": statistics.pixels, "uniform": round(statistics.uniform / max(1, statistics.pixels), 4)}


def finishing_reasons(plan: Plan, finished: Sequence[Finishing]) -> list[str]:
    """Says how views were treated that look as if they were sampled in certain ways (`models.sampling`),
    and which ones were fused.
    """
    reasons = []
    if any(view.is_averaged for view in finished):
        filtered = "views that look as if they were downscaled with an antialiasing filter"
        both = f"the results of {plan.model} and {catalogue.picture_default_name()}"
        reasons.append(f"{filtered} are means of {both}: other views add little there")
    if any(view.is_restored for view in finished):
        reasons.append("views without noise that look filtered or like means are brought closer to what was seen")
    if fused := sum(view.is_fused for view in finished):
        jpeg = "the array is a JPEG" if plan.is_jpeg else "they look filtered"
        why = "fusion is always" if plan.fusion == "always" else jpeg
        reasons.append(
            f"fusion: {fused} of {len(finished)} views are means with the upscaled views around them, as {why}"
        )
    if matched := sum(view.is_matched for view in finished):
        reasons.append(
            f"fusion: {matched} of {len(finished)} views are also brought closer to what those around them saw"
        )
    if shares := [view.interpolated for view in finished if view.interpolated]:
        maker = catalogue.picture_default_name() if plan.is_light_field else "the network"
        reasons.append(describe_average("view", shares, len(finished), maker))
    return reasons


def describe_shares(plan: Plan, finished: Sequence[Finishing]) -> list[dict[str, float]]:
    """Returns what the report's `views` say of each view besides its file: `fallback`, the share of its pixels that the
    single-picture fallback made, after a light-field network.
    """
    return [{"fallback": round(view.fallback, 4)} if plan.is_light_field else {} for view in finished]


def describe_average(what: str, shares: Sequence[float], count: int, maker: str = "the network") -> str:
    """Says that some of `count` pictures or views are means with bicubic interpolation, which has these `shares` of
    them (`models.single.finishing`), because what `maker` made doesn't fit them.
    """
    share = format_percent(max(shares))
    why = "as with noise, the errors of a JPEG or jagged edges"
    if count == 1:
        return (
            f"the {what} is a mean with bicubic interpolation ({share}), because what {maker} made doesn't fit it, "
            + why
        )
    return (
        f"{len(shares)} of {count} {what}s are means with bicubic interpolation (up to {share}), because what {maker} "
        f"made doesn't fit them, {why}"
    )


def fallback_notes(finished: Sequence[Finishing], *, of_mesh: bool) -> list[str]:
    """Returns the report's notes on misaligned views, and on the others of which the fallback made more than a
    negligible share of the pixels.
    """
    notes = []
    if misaligned := [view.misalignment for view in finished if view.is_misaligned]:
        alone = f"{len(misaligned)} of {len(finished)} views were upscaled alone, by {catalogue.picture_default_name()}"
        notes.append(
            f"{alone}: the views next to them are about {np.median(misaligned):.1f} pixels from where they should be, "
            "or in a wrong order; rectify the views, or put them in order"
        )
    others = [view.fallback for view in finished if not view.is_misaligned]
    shares = [share for share in others if share >= MINIMUM_FALLBACK_SHARE]
    if not shares:
        return notes
    where = f"in {len(shares)} of {len(finished)} views, up to " if len(finished) > 1 else ""
    name = catalogue.picture_default_name()
    made = f"{where}{100 * max(shares):.0f} % of the pixels were made by {name} from their view alone"
    captured = "another scene, a wrong order of views, noise, errors of a JPEG, or depths too far apart"
    causes = "too few lenses, or depths too far apart" if of_mesh else captured
    return [*notes, f"{made}: the neighbouring views don't match there ({causes})"]
