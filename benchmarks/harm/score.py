"""Scores a case: bicubic interpolation, the default and every network against the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.benchmarks.bench.errors import find_worst_window
from ciir.benchmarks.bench.work import reconstruct_views
from ciir.benchmarks.harm.case import LIGHT_FIELD, PICTURE, SCALE
from ciir.models import catalogue
from ciir.models.back_projection import restore_means
from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.light_field.strides import choose_stride, upscale_spaced_views
from ciir.models.light_field.views import upscale_views
from ciir.models.light_field.windows import MINIMUM_GRID
from ciir.models.single.finishing import average_misfit
from ciir.models.single.pixels import upscale_pixels
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.scene import Scene
from ciir.renderer.view_order.motion import measure_motion
from ciir.service.pipeline.job import resolve_job
from ciir.service.pipeline.options import AUTO, Options
from ciir.service.pipeline.planning.plan import make_plan
from ciir.training.evaluation.light_fields import load_network
from ciir.training.evaluation.metrics import SSIM_RADIUS, compute_psnr, compute_ssim, rgb_to_luma

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ciir.benchmarks.harm.case import Case, Kind, Picture, Views
    from ciir.renderer.views import View

BOUND = 0.1
"""How many dB the default may be below bicubic interpolation, and a light-field network below the best
single-picture network."""
SIDE = 48
"""Pixels along each side of a crop."""
BICUBIC, DEFAULT = "bicubic", "default"
"""Names of scores in addition to those of networks."""


@dataclass(frozen=True)
class Model:
    """A model that runs on the views of a case."""

    name: str
    is_light_field: bool
    upscale: Callable[[Views, View, bool], Picture]
    """Takes the views, the wanted one, and whether a light-field network's pipeline finds how views were sampled."""


@dataclass(frozen=True)
class Result:
    """The result of the default, or of the model in its place, for a case."""

    picture: Picture
    model: str
    """The model that ran."""
    is_light_field: bool
    notes: tuple[str, ...] = ()
    """The report's notes."""


@dataclass(frozen=True, eq=False)
class Row:
    """The scores of a case: Y-PSNR in dB, SSIM, and margins."""

    input: str
    kind: Kind
    factors: Mapping[str, str]
    model: str
    """The model that the default took."""
    psnr: Mapping[str, float]
    """Name -> dB; inf if exact. `bicubic`, `default`, and, but for a picture, every network that suits the grid."""
    ssim: Mapping[str, float]
    """NaN if the truth is smaller than SSIM's window."""
    best_single: str
    """The best single-picture network; empty if there is none."""
    against_bicubic: float
    """`default` - `bicubic`, dB."""
    against_single: float | None
    """`default` - `best_single`, dB; None if the default is not a light-field network, or if its fallback made the view
    alone."""
    notes: tuple[str, ...]
    crops: Mapping[str, Picture]
    """`truth`, `bicubic`, the best single-picture network and `default`, where the default loses most."""

    @property
    def margin(self) -> float:
        """The smaller of the margins, in dB."""
        return self.against_bicubic if self.against_single is None else min(self.against_bicubic, self.against_single)

    @property
    def is_over(self) -> bool:
        """Whether a margin is below `-BOUND`."""
        return self.margin < -BOUND

    @property
    def conditions(self) -> list[str]:
        """The factors as text, without those that are absent."""
        return [
            f"{name} {value}" if name in ("noise", "jpeg") else value
            for name, value in self.factors.items()
            if (name, value) not in (("noise", "0"), ("jpeg", "none"), ("order", "right"))
        ]

    @property
    def label(self) -> str:
        """The input and the conditions."""
        return f"{self.input}: {', '.join(self.conditions)}"


def list_networks() -> tuple[list[Model], dict[str, str]]:
    """Returns every network of the catalogue, and those that are left out: name -> reason."""
    networks: list[Model] = []
    left_out: dict[str, str] = {}
    for entry in catalogue.list_entries():
        if entry.card is None:
            continue
        if SCALE not in entry.scales:
            left_out[entry.name] = f"upscales by {', '.join(map(str, entry.scales))}, not by {SCALE}"
        elif entry.unsupported_reason:
            left_out[entry.name] = entry.unsupported_reason
        else:
            networks.append(load_model(entry.name))
    return networks, left_out


def load_model(name: str) -> Model:
    """Loads a model by its name in the catalogue, or an exported network by the path of its card.

    Raises `ciir.errors.ModelError` if there is no such model.
    """
    network = load_network(name, SCALE)
    is_card = name.endswith(".json")
    is_light_field = (
        isinstance(network, LightFieldNetwork) if is_card else name not in catalogue.list_single_image_names()
    )
    return Model(name, is_light_field, partial(_upscale_light_field if is_light_field else _upscale_single, network))


def _upscale_single(network: Any, views: Views, at: View, finds_sampling: bool = False) -> Picture:  # noqa: ARG001
    picture: Picture = upscale_pixels(network, views[at][np.newaxis])[0]
    return picture


def _upscale_light_field(network: Any, views: Views, at: View, finds_sampling: bool) -> Picture:
    grid = (views.shape[0], views.shape[1])
    every = {(v, u): views[v, u] for v in range(grid[0]) for u in range(grid[1])}
    fallback = catalogue.load_upscaler(catalogue.picture_default_name(), scale=SCALE)
    stride = choose_stride(measure_motion(views), grid) if finds_sampling else 1  # not for a mesh's views
    upscale = partial(upscale_views, network, fallback, finds_sampling=finds_sampling)
    made, _ = upscale_spaced_views(upscale, every, [at], grid, stride)
    return np.asarray(made[0], np.uint8)


def reconstruct_case(case: Case, model: str) -> Result:
    """Reconstructs the wanted view of `case` in the pipeline, with the model `auto` or one of the catalogue.

    If the pipeline would render views of a mesh that are the lens array's, it gets those that were rendered for all
    models: they are the same to the bit.
    """
    source, options = case.source, replace(case.options, model=model)
    if isinstance(source, Scene):
        plan = make_plan(resolve_job(case.input, source, options, max_views=DEFAULT_LIMITS.views))
        if plan.is_light_field and not plan.moves_array:
            source = LightField(case.views)
            options = Options(views=f"{case.at[0]},{case.at[1]}", model=plan.model, sampling=options.sampling)
    pictures, report = reconstruct_views(source, options)
    name = report["model"]["name"]
    is_light_field = catalogue.get_entry(name).is_light_field
    return Result(pictures[0], name, is_light_field, tuple(report["notes"]))


def make_subject(model: str) -> Callable[[Case], Result]:
    """Returns the subject that is judged: `auto` or a model of the catalogue in the pipeline, or an exported network by
    its card's path.

    Raises `ciir.errors.ModelError` if there is no such model.
    """
    if model != AUTO:
        loaded = load_model(model)
        if model.endswith(".json"):
            return lambda case: Result(_upscale_case(loaded, case), model, loaded.is_light_field)
    return partial(reconstruct_case, model=model)


def score_case(case: Case, networks: Sequence[Model], subject: Callable[[Case], Result]) -> Row:
    """Runs everything on `case`. Light-field networks are left out for grids that are too small for them, and all
    `networks` for a picture, which no bound compares with them.
    """
    networks = () if case.kind == PICTURE else networks
    result = subject(case)
    pictures = {BICUBIC: _upscale_single(catalogue.load_upscaler(BICUBIC, scale=SCALE), case.views, case.at)}
    pictures[DEFAULT] = result.picture
    singles = [network.name for network in networks if not network.is_light_field]
    for network in networks:
        if not network.is_light_field or min(case.views.shape[:2]) >= MINIMUM_GRID:
            pictures[network.name] = _upscale_case(network, case)
    psnr, ssim = {}, {}
    truth = rgb_to_luma(case.truth)
    has_ssim = min(truth.shape) - 2 * case.border > 2 * SSIM_RADIUS
    for name, picture in pictures.items():
        luma = rgb_to_luma(picture)
        psnr[name] = compute_psnr(luma, truth, border=case.border)
        ssim[name] = compute_ssim(luma, truth, border=case.border) if has_ssim else math.nan
    best = max(singles, key=psnr.__getitem__, default="")
    against_bicubic = _subtract(psnr[DEFAULT], psnr[BICUBIC])
    alone = pictures.get(catalogue.picture_default_name())
    is_helped = result.is_light_field and not (alone is not None and _is_alone(result.picture, alone, case))
    against_single = _subtract(psnr[DEFAULT], psnr[best]) if best and is_helped else None
    is_single_worse = against_single is not None and against_single < against_bicubic
    shown = {"truth": case.truth, BICUBIC: pictures[BICUBIC]}
    shown |= {best: pictures[best]} if best else {}
    window = find_worst_window(result.picture, case.truth, pictures[best if is_single_worse else BICUBIC], side=SIDE)
    return Row(
        input=case.input,
        kind=case.kind,
        factors=case.factors,
        model=result.model,
        psnr=psnr,
        ssim=ssim,
        best_single=best,
        against_bicubic=against_bicubic,
        against_single=against_single,
        notes=result.notes,
        crops={name: picture[window].copy() for name, picture in (shown | {DEFAULT: result.picture}).items()},
    )


def _upscale_case(network: Model, case: Case) -> Picture:
    """Returns what the pipeline makes of a case with a network."""
    is_lenslet = case.options.sampling == "lenslet"
    picture = network.upscale(case.views, case.at, case.kind == LIGHT_FIELD and not is_lenslet)
    return restore_means(picture, case.views[case.at]) if is_lenslet else picture


def is_same(picture: Picture, other: Picture) -> bool:
    """Checks whether pictures are equal but for rounding."""
    return bool(np.abs(picture.astype(np.int16) - other).max() <= 1)


def _is_alone(picture: Picture, single: Picture, case: Case) -> bool:
    """Checks whether `picture` is that of the single-picture default, `single`, as the fallback finishes it."""
    averaged = single.copy()
    average_misfit(averaged, case.views[case.at])
    return is_same(averaged, picture)


def _subtract(psnr: float, other: float) -> float:
    """Returns the difference of two PSNRs; 0 if both are exact."""
    return 0.0 if psnr == other else psnr - other
