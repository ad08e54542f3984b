"""Makes depth planes without what stands in front of them.

Along a line of the light field that meets the plane, the views that see the plane agree. Those that see something in
front of it differ, also from each other if that is textured. So the plane's colour is the mode of the line, whereas the
mean mixes both and the median needs most views to see the plane (Vaish et al., CVPR 2006, compare such measures). The
mode is found as the pixel that most others agree with, and then as the mean with weights that fall with the difference
from it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from ciir.bit_depth import count_unused_bits
from ciir.cores import count_available_cores
from ciir.errors import InvalidOption
from ciir.renderer.focus.kernels import REACH, make_sinc_taps
from ciir.renderer.focus.planes import read_disparities, refocus
from ciir.renderer.focus.stereo.noise import DIFFERENCE, estimate_noise
from ciir.renderer.levels import drop_alpha
from ciir.renderer.views import center_view

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ciir.renderer.focus.planes import Method, Numbers

Occluders = Literal["keep", "remove"]

CANDIDATES = 16
"""Views whose pixels may be the mode. They lie anywhere in the grid: a fence might hide all of a regular pattern."""
_BLOCK = 2**21
"""Samples that are compared at a time, few enough for the processor's cache."""


def make_planes(
    views: NDArray[Any],
    disparities: Numbers,
    weights: NDArray[np.float32],
    method: Method,
    occluders: Occluders,
) -> Iterator[NDArray[np.float32]]:
    """Makes the planes of `planes.refocus`; with `remove`, what stands in front of a plane does not count.

    If fewer views see the plane than see one colour in front of it, that colour remains. What lies behind the plane is
    patchy rather than blurred. Raises `InvalidOption` for what `planes.refocus` refuses, for unknown `occluders`, and
    for `remove` with another method than `mapping`.
    """
    if occluders not in get_args(Occluders):
        raise InvalidOption(f"occluders: {occluders!r} is not known; give {' or '.join(get_args(Occluders))}")
    if occluders == "keep":
        return refocus(views, disparities, method=method, weights=weights)
    if method != "mapping":
        raise InvalidOption(f"occluders: they are not removed with the method {method}; give mapping")
    return (_make_plane(views, float(disparity), weights) for disparity in read_disparities(disparities))


def _make_plane(views: NDArray[Any], disparity: float, weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Makes one plane, `(H, W, C)`, in blocks of rows."""
    height = views.shape[2]
    level = np.iinfo(views.dtype).max / 255 / 2 ** count_unused_bits(views)
    tolerance = (DIFFERENCE * level) ** 2 + 2 * estimate_noise(views[center_view(*views.shape[:2])]) ** 2
    step = max(1, _BLOCK * height // views.size)
    blocks = [np.arange(start, min(start + step, height)) for start in range(0, height, step)]
    with ThreadPoolExecutor(count_available_cores()) as pool:
        return np.concatenate(list(pool.map(partial(_make_rows, views, disparity, weights, tolerance), blocks)))


def _make_rows(
    views: NDArray[Any],
    disparity: float,
    weights: NDArray[np.float32],
    tolerance: float,
    rows: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Makes the rows `rows` of a plane, `(h, W, C)`."""
    samples, reached = _line_up(views, disparity, weights, rows)
    counting = np.flatnonzero(weights)
    candidates = np.random.default_rng(0).permutation(counting)[:CANDIDATES]
    most = np.zeros(samples.shape[1:3], np.float32)
    mode = _average(samples, reached)
    for candidate in candidates:
        agreeing = _compare(samples, samples[candidate], tolerance, reached).sum(axis=0)
        is_more = (agreeing > most) & (reached[candidate] > 0)
        np.copyto(most, agreeing, where=is_more)
        np.copyto(mode, samples[candidate], where=is_more[..., np.newaxis])
    for _ in range(2):
        shares = _compare(samples, mode, tolerance, reached)
        mode = _average(samples, shares)
    return mode


def _average(samples: NDArray[np.float32], shares: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the mean `(h, W, C)` of samples with these shares `(views, h, W)`; 0 where no sample has one."""
    mean: NDArray[np.float32] = np.einsum("khwc,khw->hwc", samples, shares)
    mean /= np.maximum(shares.sum(axis=0), 1e-9)[..., np.newaxis]
    return mean


def _compare(
    samples: NDArray[np.float32], colours: NDArray[np.float32], tolerance: float, reached: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Returns how much each sample counts for these colours, `(views, h, W)`."""
    differences = drop_alpha(samples - colours)
    squares = np.einsum("khwc,khwc->khw", differences, differences)
    shares: NDArray[np.float32] = np.exp(squares * np.float32(-1 / (tolerance * differences.shape[3]))) * reached
    return shares


def _line_up(
    views: NDArray[Any], disparity: float, weights: NDArray[np.float32], rows: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns the views, shifted so that the plane lines up, `(views, h, W, C)`, and their weights where they reach,
    else 0.
    """
    count_v, count_u, height, width, channels = views.shape
    samples = np.empty((count_v, count_u, len(rows), width, channels), np.float32)
    reached = np.empty(samples.shape[:4], np.float32)
    for v in range(count_v):
        down, is_row = _find_sources(rows, disparity * (v - (count_v - 1) / 2), height)
        strip = sum(tap * views[v][:, source] for tap, source in down)  # (U, h, W, C)
        for u in range(count_u):
            across, is_col = _find_sources(np.arange(width), disparity * (u - (count_u - 1) / 2), width)
            samples[v, u] = sum(tap * strip[u][:, source] for tap, source in across)
            reached[v, u] = weights[v, u] * is_row[:, np.newaxis] * is_col
    return samples.reshape(-1, *samples.shape[2:]), reached.reshape(-1, *reached.shape[2:])


def _find_sources(
    places: NDArray[np.int64], shift: float, length: int
) -> tuple[list[tuple[np.float32, NDArray[np.int64]]], NDArray[np.bool_]]:
    """Returns the weights and indices of the samples that make up a signal shifted by `shift`, and where it is
    inside.
    """
    shift = float(np.clip(shift, -length - 1, length + 1))  # beyond that, all is outside
    whole = int(np.floor(-shift))
    taps = make_sinc_taps(np.asarray(-shift - whole)).astype(np.float32)
    offsets = range(1 - REACH, REACH + 1)
    sources = [(tap, (places + whole + by).clip(0, length - 1)) for tap, by in zip(taps, offsets, strict=True) if tap]
    return sources, (places - shift >= 0) & (places - shift <= length - 1)
