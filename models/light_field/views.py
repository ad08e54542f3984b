"""Views of a light field upscaled together: which others each one needs, and what comes out."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from ciir.errors import InvalidImage
from ciir.models.light_field import disparity
from ciir.models.light_field import skipping as light_field_skipping
from ciir.models.light_field.windows import list_window, select_axis
from ciir.models.parallel import each, suits
from ciir.models.sessions import BATCH, WINDOW
from ciir.models.single import skipping
from ciir.models.single.pixels import upscale_pixels
from ciir.models.single.skipping import SkipStatistics
from ciir.models.tiles import split

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.models.light_field.disparity import Pixels
    from ciir.models.light_field.network import LightFieldNetwork
    from ciir.models.light_field.windows import Axis
    from ciir.models.tiles import Tile
    from ciir.models.upscaler import Upscaler

    View = tuple[int, int]

CONFIDENT, UNCERTAIN = 0.6, 0.75
"""Doubt up to which the light-field network's picture is taken, and from which the other's is. Views of one scene come
to 0.15 to 0.5 (Lego Knights, rendered meshes; nine tenths of all pixels), strange ones to 0.6 to 1."""
MINIMUM_FALLBACK_SHARE = 0.1
"""Share of a view's pixels in doubt that is left as it is: at silhouettes some always are."""
ROWS = 256
"""Rows of a picture that are blended at once."""


def list_required_views(wanted: Sequence[View], grid: tuple[int, int]) -> list[View]:
    """Every view (v, u) of the windows about `wanted`, in a grid of `grid` views, row by row and each once."""
    return sorted({view for at in wanted for view, _ in list_window(at, grid)})


def upscale_views(
    network: LightFieldNetwork,
    fallback: Upscaler,
    views: Mapping[View, Pixels],
    wanted: Sequence[View],
    grid: tuple[int, int],
    *,
    skip: bool = True,
    statistics: SkipStatistics | None = None,
) -> tuple[Pixels, float]:
    """The views `wanted` of a light field of `grid` = (V, U) views, `(len(wanted), scale*H, scale*W, C)`; and the share
    of their pixels that `fallback`, a model of single pictures, made for the most part.

    That is where the views around don't match: another scene, noise, disparities that none of the network's planes has.
    Between `CONFIDENT` and `UNCERTAIN` of its doubt one goes over into the other, in views of which more than
    `MINIMUM_FALLBACK_SHARE` is in doubt. Where the content of a view moves by more than a whole pixel to the next,
    views are first moved back by whole pixels (`models.light_field.disparity`). What a view becomes does not depend on
    which others are wanted.

    `views`: (v, u) -> `(H, W, C)`, grey or RGB, 8 or 16 bit, all of one shape and type;
    at least those of `list_required_views`.
    Grey comes back as the mean of three channels. The result is of the same type, rounded to nearest. Large views are
    made in tiles, of all views one place after the other: what is held beside input and result stays small.

    `skip`: whether to leave out what `models.single.skipping` and `models.light_field.skipping` find, which doesn't
    change the result;
    what was skipped is added to `statistics`.

    Raises `InvalidImage` where the views differ in shape or type, or have alpha or another number of channels.
    """
    first = _alike(views, wanted[0], list_required_views(wanted, grid))
    statistics = SkipStatistics() if statistics is None else statistics
    pixels = first.shape[0] * first.shape[1]
    statistics.pixels += len(wanted) * pixels
    may_repeat = skip and len(wanted) > 1
    firsts = light_field_skipping.repeats(views, wanted, grid) if may_repeat else list(range(len(wanted)))
    singles = sorted(set(firsts))
    statistics.repeated += (len(wanted) - len(singles)) * pixels
    job = _Job(network, views, grid, skip, statistics)
    result, left = _blended(job, fallback, [wanted[number] for number in singles])
    places = np.searchsorted(singles, firsts)
    return result if len(singles) == len(wanted) else result[places], float(left[places].mean())


class _Job(NamedTuple):
    """What is upscaled, and by what."""

    network: LightFieldNetwork
    views: Mapping[View, Pixels]
    grid: tuple[int, int]
    skip: bool
    statistics: SkipStatistics


def _blended(job: _Job, fallback: Upscaler, wanted: Sequence[View]) -> tuple[Pixels, NDArray[np.float64]]:
    """The views `wanted`, and the share of each that `fallback` made."""
    scale, first = job.network.scale, job.views[wanted[0]]
    height, width, channels = first.shape
    result = np.empty((len(wanted), height * scale, width * scale, channels), first.dtype)
    doubt = np.empty((len(wanted), height, width, 1), np.float32)
    alike: dict[int, dict[int, View]] = {}
    for number, at in enumerate(wanted):
        alike.setdefault(disparity.of(job.views, at, job.grid), {})[number] = at
    colours = {number: _fill(job, at, result[number], doubt[number]) for number, at in enumerate(wanted)}
    for by, chosen in alike.items():
        _make(job, chosen, colours, by, _Made(result, doubt))
    left = np.zeros(len(wanted))
    for number, at in enumerate(wanted):
        strange = np.clip((doubt[number, ..., 0] - CONFIDENT) / (UNCERTAIN - CONFIDENT), 0, 1)
        if np.mean(strange > 0) > MINIMUM_FALLBACK_SHARE:
            _blend(result[number], _upscale_alone(fallback, job.views[at], job.skip), strange)
            left[number] = np.mean(strange > 0.5)
    return result, left


def _fill(job: _Job, at: View, result: Pixels, doubt: NDArray[np.float32]) -> Pixels | None:
    """Makes `result` and `doubt` what view `at` becomes where all is the colour around the object, which is returned;
    None where there is no such colour.
    """
    network = job.network
    colour = light_field_skipping.colour(network, job.views[at]) if job.skip else None
    if colour is not None:
        large, doubtful = light_field_skipping.pattern(network, colour, at, job.grid)
        skipping.fill(result, _rounded(large, result), network.radius, network.scale)
        skipping.fill(doubt, doubtful, network.radius, 1)
    return colour


def _make(
    job: _Job,
    chosen: Mapping[int, View],
    colours: Mapping[int, Pixels | None],
    by: int,
    made: _Made,
) -> None:
    """Puts into `made` each of the views `chosen`, under its number, but for what is one of `colours` all
    around. The views around are moved by `by`.
    """
    network, views, grid = job[:3]
    every = list_required_views(list(chosen.values()), grid)
    height, width = views[every[0]].shape[:2]
    for tile in split(height, width, radius=network.radius, window=WINDOW):
        lumas = {view: disparity.luma(views[view], tile.window, by) for view in every}
        differing = light_field_skipping.Differing(views, grid, tile, by)
        parts: list[tuple[int, Tile]] = []
        for number, at in chosen.items():
            colour = colours[number]
            boxes = [tile] if colour is None else differing.boxes(at, colour, network.radius, job.statistics)
            parts += [(number, box) for box in boxes]
        runs = list(_together(parts, chosen, grid))
        abreast = network.threads if suits(len(runs), network.threads) else 1
        run = _Run(job, chosen, tile, lumas, by, made, cores=network.threads if abreast == 1 else 1)
        each(run.make, runs, abreast)


class _Made(NamedTuple):
    """What is filled in, by the numbers of views."""

    pictures: Pixels
    """`(n, scale*H, scale*W, C)`."""
    doubt: NDArray[np.float32]
    """`(n, H, W, 1)`."""


class _Run(NamedTuple):
    """Runs of the network on parts of one tile; may be called from several threads: where two parts of a view overlap,
    what they make is the same to the bit.
    """

    job: _Job
    chosen: Mapping[int, View]
    tile: Tile
    lumas: Mapping[View, disparity.Plane]
    by: int
    made: _Made
    cores: int

    def make(self, run: tuple[Axis, Axis, Sequence[tuple[int, Tile]]]) -> None:
        """Makes some parts, all of one size, of views by their numbers."""
        network, views, grid = self.job[:3]
        rows, cols, some = run
        image = np.stack([_colour(views[self.chosen[number]][part.window]) for number, part in some])
        around = np.stack([self._around(part, self.chosen[number], grid) for number, part in some])
        both = network(image, around, rows.present, cols.present, cores=self.cores)
        large, doubt = (one.transpose(0, 2, 3, 1) for one in both)
        for (number, part), picture, doubtful in zip(some, large, doubt, strict=True):
            kept = _rounded(picture[part.source(network.scale)], self.made.pictures)
            self.made.pictures[number][part.target(network.scale)] = kept
            self.made.doubt[number][part.kept] = doubtful[part.source(1)]

    def _around(self, tile: Tile, at: View, grid: tuple[int, int]) -> NDArray[np.float32]:
        """A part of the views of a window about one, `(25, h, w)`."""
        part = tile.inside(self.tile.window)
        return np.stack(
            [disparity.moved(self.lumas[view], self.by, offset)[part] for view, offset in list_window(at, grid)]
        )


def _rounded(picture: NDArray[np.float32], like: Pixels) -> NDArray[np.float32]:
    """`(h, w, 3)` in [0, 1] -> whole levels of the channels and the type of `like`."""
    grey = picture.mean(axis=2, keepdims=True) if like.shape[-1] == 1 else picture
    levels: NDArray[np.float32] = np.floor(grey * np.float32(np.iinfo(like.dtype).max) + np.float32(0.5))
    return levels


def _upscale_alone(upscaler: Upscaler, view: Pixels, skip: bool) -> Pixels:
    # Its type variable takes 8 or 16 bit, where a view is either: one of them stands for both.
    made: Pixels = upscale_pixels(upscaler, cast("NDArray[np.uint8]", view[np.newaxis]), skip=skip)[0]
    return made


def _blend(picture: Pixels, other: Pixels, share: NDArray[np.float32]) -> None:
    """Puts `share` `(H, W)` of `other` into `picture`, both `(scale*H, scale*W, C)`."""
    scale = len(picture) // len(share)
    for first in range(0, len(share), ROWS):
        part = slice(first * scale, (first + ROWS) * scale)
        of = share[first : first + ROWS].repeat(scale, axis=0).repeat(scale, axis=1)[..., np.newaxis]
        mixed = (1 - of) * picture[part].astype(np.float32) + of * other[part].astype(np.float32)
        picture[part] = np.floor(mixed + np.float32(0.5))


def _alike(views: Mapping[View, Pixels], one: View, every: Sequence[View]) -> Pixels:
    """View `one`, once it is known to be a picture and the others to be like it."""
    first = views[one]
    if first.ndim != 3 or first.shape[2] not in (1, 3) or first.dtype not in (np.uint8, np.uint16):
        raise InvalidImage(
            f"views of shape {first.shape} and {first.dtype}: give (H, W, C), grey or RGB, of 8 or 16 bit"
        )
    for v, u in every:
        other = views[v, u]
        if other.shape != first.shape or other.dtype != first.dtype:
            raise InvalidImage(
                f"view {v},{u}: {other.shape} of {other.dtype}, where view {one[0]},{one[1]} is {first.shape} of "
                f"{first.dtype}; give views of one size and depth"
            )
    return first


def _together(
    parts: Sequence[tuple[int, Tile]], chosen: Mapping[int, View], grid: tuple[int, int]
) -> Iterator[tuple[Axis, Axis, Sequence[tuple[int, Tile]]]]:
    """The parts of one size, of views whose windows stand alike, up to `BATCH` pixels at a time."""
    groups: dict[tuple[object, ...], list[tuple[int, Tile]]] = {}
    for number, part in parts:
        v, u = chosen[number]
        there = select_axis(v, grid[0]).present.tobytes() + select_axis(u, grid[1]).present.tobytes()
        rows, cols = part.window
        groups.setdefault((there, rows.stop - rows.start, cols.stop - cols.start), []).append((number, part))
    for some in groups.values():
        v, u = chosen[some[0][0]]
        most = max(1, BATCH // skipping.area(some[0][1].window))
        for begin in range(0, len(some), most):
            yield select_axis(v, grid[0]), select_axis(u, grid[1]), some[begin : begin + most]


def _colour(picture: Pixels) -> NDArray[np.float32]:
    """`(H, W, 1 or 3)` -> `(3, H, W)` in [0, 1]."""
    return np.broadcast_to(disparity.as_float(picture), (*picture.shape[:2], 3)).transpose(2, 0, 1)
