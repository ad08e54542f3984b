"""Compares both rendering backends with ray casting where float32 is at its limits, and lists geometry's cases."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.geometry import disparity, pixel_mapping, planes, shapes, surfaces
from ciir.benchmarks.stress.geometry.agreement import compare_backends, open_backends
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scenes import load_scene

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.renderer.scene import Scene

ARRAY = LensArray(50, 50, 15, 15)
VIEWS = ((0, 14), (7, 7))
SCALES = (1e-6, 1e-3, 1.0, 1e3, 1e6)
AWAY = 1e6
"""How many units a scene is moved."""
SLOW = 150
"""Rays of each view that are also cast in float64."""


def _scenes(effort: Effort) -> Iterator[tuple[str, Scene]]:
    """Yields a plain scene, and a textured one."""
    yield from ((name, load_scene(name)) for name in (("vase",) if effort.quick else ("vase", "hamburger")))


def _scales(effort: Effort) -> tuple[float, ...]:
    return (SCALES[0], SCALES[-1]) if effort.quick else SCALES


def _scale_and_move(of: Scene, scale: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Scene:
    """Returns the scene scaled about the origin, then moved. Its light stays as it was."""
    matrix = np.diag([scale, scale, scale, 1.0])
    matrix[:3, 3] = offset
    return of.transform(matrix)


def framed(effort: Effort) -> Iterator[Found | Skipped]:
    """Renders meshes scaled by 1e-6 to 1e6 and moved 1e6 units along each axis, framed as the service frames them."""
    views = VIEWS[1:] if effort.quick else VIEWS
    for name, whole in _scenes(effort):
        for scale in _scales(effort):
            for offset in (0.0, AWAY):
                mesh = _scale_and_move(whole, scale, (offset, -offset, offset))
                placed = mesh.transform(frame_scene(mesh, ARRAY))
                yield from compare_backends(f"{name} x{scale:g} moved {offset:g}", placed, ARRAY, views, slow=SLOW)


def change_units(effort: Effort) -> Iterator[Found | Skipped]:
    """Renders a lens array and a scene in units of 1e-6 to 1e6, and an object 1e6 pitches away."""
    views = VIEWS[1:] if effort.quick else VIEWS
    for name, whole in _scenes(effort):
        placed = whole.transform(frame_scene(whole, ARRAY))
        for scale in _scales(effort):
            array = replace(ARRAY, pitch=scale)
            yield from compare_backends(
                f"{name}, pitch {scale:g}", _scale_and_move(placed, scale), array, views, slow=SLOW
            )
        # At that distance all views show the object only if the tangents are as small.
        array = replace(ARRAY, delta=ARRAY.delta * 20 / AWAY)
        far = _scale_and_move(placed, 1.0, (0.0, 0.0, -AWAY))
        yield from compare_backends(f"{name}, {AWAY:g} pitches away", far, array, views, slow=SLOW)


def many_triangles(effort: Effort) -> Iterator[Found | Skipped]:
    """Renders rolling hills of up to two million triangles, up to 90 in each pixel."""
    for count in (20_000,) if effort.quick else (1_000_000, 2_000_000):
        whole = shapes.make_hills(count)
        array = replace(ARRAY, rows=150, cols=150)
        placed = whole.transform(frame_scene(whole, array))
        yield from compare_backends(f"hills of {whole.triangles:,} triangles", placed, array, VIEWS[:1], slow=SLOW // 4)


def slivers(effort: Effort) -> Iterator[Found | Skipped]:
    """Renders a disc of needles whose colour is linear in the position: up to a million, 160,000 times longer than
    wide.
    """
    array = replace(ARRAY, rows=40, cols=40)
    x, y = np.meshgrid(array.lens_x(), array.lens_y())
    truth = 255.0 * shapes.compute_ramp(x, y, 60.0)
    for count in (1000,) if effort.quick else (1000, 100_000, 1_000_000):
        disc = shapes.make_needles(count, radius=30.0, distance=20.0)
        aspect = count / (2 * np.pi)
        # Rounding to 8 bits, and weights divided by an area: as much worse in float32 as the needle is longer.
        bound = 0.5 + 127.5 * 2.0**-24 * max(aspect, 1000.0)
        backends, skipped = open_backends("needles")
        yield from skipped
        for backend in backends:
            (picture,) = backend.render_views(disc, array, VIEWS[1:])
            what = f"{count:,} needles, {backend.name}"
            yield Found(f"{what}: holes, pixels", 0.0, float((picture[..., 3] == 0).sum()))
            yield Found(f"{what}: worst colour, levels", bound, float(np.abs(picture[..., :3] - truth).max()))


CASES: tuple[Case, ...] = (
    *pixel_mapping.CASES,
    *planes.CASES,
    *disparity.CASES,
    framed,
    change_units,
    slivers,
    *surfaces.CASES,
    many_triangles,
)
