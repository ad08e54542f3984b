"""The inputs: pictures made by code, and patterns that do not occur in pictures.

All are float32 `(3, H, W)`, in [0, 1] except for those of `make_outside`.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import SCENES, load_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Values = NDArray[np.float32]

DENORMAL = 1e-40
"""A value below the least normal float32, 1.2e-38."""
SAMPLES = 4
"""Rays along each side of a pixel of `render_views`."""


def make_natural(height: int, width: int, *, seed: int = 0) -> Values:
    """Makes noise whose amplitude falls as 1/frequency, like that of photographs (Field, J. Opt. Soc. Am. A 4(12),
    1987).

    The mean is 0.5 and the standard deviation 0.18; the channels share three quarters of their amplitude.
    """
    random = np.random.default_rng((seed, height, width))
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width))
    frequency[0, 0] = np.inf
    white = random.standard_normal((4, height, width))
    grey, *colours = np.fft.irfft2(np.fft.rfft2(white) / frequency, s=(height, width))
    picture = 0.75 * grey + 0.25 * np.stack(colours)
    return np.asarray(np.clip(0.5 + 0.18 * picture / max(float(picture.std()), 1e-6), 0, 1), np.float32)


@cache
def render_views(side: int) -> dict[str, Values]:
    """Renders the shipped scenes, each as the middle view of a lens array of `side x side`, 16 rays a lens."""
    array = LensArray(side, side, 1, 1)
    return {name: _view(name, array) for name in SCENES}


def _view(name: str, array: LensArray) -> Values:
    found = load_scene(name)
    (view,) = RaytraceBackend().render_views(
        found.transform(frame_scene(found, array)), array, [(0, 0)], samples=SAMPLES, background=(40, 44, 52)
    )
    return np.ascontiguousarray(np.moveaxis(view[..., :3], 2, 0), np.float32) / np.float32(255)


def make_pictures(side: int) -> dict[str, Values]:
    """Makes pictures of the kind that networks are made for: `render_views`, and `make_natural`."""
    return {**render_views(side), "1/f noise": make_natural(side, side)}


def make_patterns(height: int, width: int) -> dict[str, Values]:
    """Makes constants, one hot pixel, checkerboards and stripes up to Nyquist, steps, noises, denormals."""
    random = np.random.default_rng((0, height, width))
    y, x = np.mgrid[:height, :width]
    hot = np.zeros((3, height, width), np.float32)
    hot[:, height // 2, width // 2] = 1
    shape = (3, height, width)
    planes = {
        "black": np.zeros(shape),
        "grey": np.full(shape, 0.5),
        "white": np.ones(shape),
        "red": np.full(shape, 1.0) * [[[1]], [[0]], [[0]]],
        "one hot pixel": hot,
        "one cold pixel": 1 - hot,
        "checkerboard": (x + y) % 2,
        "checkerboard of colours": np.stack([(x + y) % 2, (x + y + 1) % 2, x % 2]),
        "checkerboard of 2x2": (x // 2 + y // 2) % 2,
        "stripes across": x % 2,
        "stripes down": y % 2,
        "step": x >= width // 2,
        "ramp": x / max(1, width - 1),
        "uniform noise": random.random(shape),
        "black and white noise": random.integers(0, 2, shape),
        "faint noise": 0.5 + random.standard_normal(shape) / 255,
        "denormals": np.full(shape, DENORMAL),
        "noise of denormals": DENORMAL * random.random(shape),
    }
    return {name: _picture(plane, shape) for name, plane in planes.items()}


def make_sinusoids(side: int, steps: int) -> dict[str, Values]:
    """Makes `0.5 + 0.5 cos` along all pairs of frequencies from 0 to Nyquist in `steps` steps, in both slants."""
    y, x = np.mgrid[:side, :side]
    found = {}
    for down in range(steps + 1):
        for across in range(-steps + 1, steps + 1):
            wave = 0.5 + 0.5 * np.cos(np.pi * (down * y + across * x) / steps)
            found[f"wave of {down}/{2 * steps} down, {across}/{2 * steps} across"] = _picture(wave, (3, side, side))
    return found


def make_outside(height: int, width: int) -> dict[str, Values]:
    """Makes values up to +-10, outside the range of pictures."""
    random = np.random.default_rng((height, width))
    shape = (3, height, width)
    y, x = np.mgrid[:height, :width]
    planes = {
        "10 everywhere": np.full(shape, 10.0),
        "-10 everywhere": np.full(shape, -10.0),
        "checkerboard of +-10": 20.0 * ((x + y) % 2) - 10,
        "noise in +-10": random.uniform(-10, 10, shape),
        "just above 1": np.full(shape, np.nextafter(np.float32(1), np.float32(2))),
        "just below 0": np.full(shape, -np.float32(DENORMAL)),
    }
    return {name: _picture(plane, shape) for name, plane in planes.items()}


def _picture(plane: NDArray[np.generic], shape: tuple[int, ...]) -> Values:
    return np.ascontiguousarray(np.broadcast_to(plane, shape), np.float32)
