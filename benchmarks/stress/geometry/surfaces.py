"""Surfaces close behind one another, surfaces in one plane, and degenerate triangles."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.stress.case import Found, Skipped
from ciir.benchmarks.stress.geometry import shapes
from ciir.benchmarks.stress.geometry.agreement import FLOAT_BAND, RAY_LEVELS, compare, open_backends
from ciir.benchmarks.stress.geometry.rays import build_slow_sight
from ciir.errors import InvalidGeometry
from ciir.renderer.backends import open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.scene import Scene
from ciir.renderer.surface import Surface, assemble_scene

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.benchmarks.stress.case import Case, Effort
    from ciir.renderer.backends import Backend

SIDE = 20
ARRAY = LensArray(SIDE, SIDE, 3, 3)
STRAIGHT = LensArray(SIDE, SIDE, 3, 3, delta=1e-6)
"""An array whose rays stay in front of it over a million pitches."""
VIEWS = ((0, 0), (1, 1))
ORDERED = 2.0**-22
"""The gap between two surfaces that both backends order, as a share of the scene's depth. A depth buffer of 24 bits
over 1.02 times that depth resolves 2^-24, and each of the two may be rounded towards the other, once as a vertex and
once in clip space."""
PASSED = 8e-6
"""The gap between cut-out surfaces that rays resolve, as a share of the scene's longest side: four times
`renderer.backends.embree.STEP`, which is 2e-6 of it."""


def _count_wrong_pixels(backend: Backend, scene: Scene, array: LensArray, color: Sequence[float]) -> float:
    """Counts pixels of the scene's views that have another colour than `color`, RGB in [0, 1]."""
    rgba = np.append(255.0 * np.asarray(color), 255.0)
    return float(sum((picture != rgba).any(axis=2).sum() for picture in backend.render_views(scene, array, VIEWS)))


def depth_order(effort: Effort) -> Iterator[Found | Skipped]:
    """Places a sheet just behind another, at the near plane, half way and at the far plane, from 1e-3 to 1e6 away."""
    ranges = [(1.0, 50.0), (1e-3, 1e6)] if effort.quick else [(1.0, 50.0), (1e-3, 50.0), (1.0, 1e6), (1e-3, 1e6)]
    backends, skipped = open_backends("depth order")
    yield from skipped
    for backend in backends:
        for near, far in ranges:
            wrong, gap = 0.0, ORDERED * (far - near)
            for front in (near, (near + far) / 2, far - gap):
                pair = [shapes.make_sheet(front, 60.0, shapes.RED), shapes.make_sheet(front + gap, 60.0, shapes.GREEN)]
                ends = [shapes.make_speck(near, 1000.0), shapes.make_speck(far, 1000.0)]
                for order in (pair, pair[::-1]):
                    wrong += _count_wrong_pixels(backend, Scene((*order, *ends)), STRAIGHT, shapes.RED)
            yield Found(
                f"{backend.name}: depth {near:g} to {far:g}, gap {gap:.3g}, pixels of the hidden sheet", 0.0, wrong
            )


def depth_order_by_lens(effort: Effort) -> Iterator[Found | Skipped]:
    """Does the same for perspective renders of one lens each, whose depth buffer resolves less at larger distances."""
    array = LensArray(2, 2, SIDE, SIDE)
    backends, skipped = open_backends("depth order by lens")
    yield from skipped
    for backend in (each for each in backends if each.name == "raster"):
        for near, far in [(1.0, 21.0)] if effort.quick else [(1.0, 21.0), (1.0, 100.0), (1e-2, 100.0)]:
            wrong = 0.0
            for front in (near, (near * far) ** 0.5, 0.9 * far):
                # Depth is a + b / d in clip space. 24 bits resolve d^2 / near plane * 2^-24 at distance d, float32
                # resolves d * depth / near plane * 2^-24; the near plane is at half of `near` or more.
                gap = 4 * front * (front + far - near) / (near / 2) * 2.0**-24
                side = 2.0 * far
                pair = [shapes.make_sheet(front, side, shapes.RED), shapes.make_sheet(front + gap, side, shapes.GREEN)]
                ends = [shapes.make_speck(near, 10 * far), shapes.make_speck(far, 10 * far)]
                for order in (pair, pair[::-1]):
                    eia = backend.render_eia(Scene((*order, *ends)), array)
                    wrong += float((eia[..., :2] != (255, 0)).any(axis=2).sum())
            yield Found(f"raster by lens: depth {near:g} to {far:g}, pixels of the hidden sheet", 0.0, wrong)


def coplanar(effort: Effort) -> Iterator[Found | Skipped]:  # noqa: ARG001 - a case's signature
    """Places two sheets in one plane, which show one or the other and the same each time; seams where samples lie."""
    red, green = (
        shapes.make_sheet(30.0, 60.0, shapes.RED, slope=0.3),
        shapes.make_sheet(30.0, 50.0, shapes.GREEN, slope=0.3),
    )
    mosaic = shapes.make_mosaic(
        SIDE * 2, side=2.0 * SIDE, distance=30.0
    )  # half a pitch each: corners on every other ray
    backends, skipped = open_backends("coplanar sheets")
    yield from skipped
    for backend in backends:
        both, again = (np.stack(list(backend.render_views(Scene((red, green)), ARRAY, VIEWS))) for _ in range(2))
        neither = ~((both == (255, 0, 0, 255)).all(axis=3) | (both == (0, 255, 0, 255)).all(axis=3))
        yield Found(f"{backend.name}: two sheets in one plane, pixels of neither's colour", 0.0, float(neither.sum()))
        yield Found(f"{backend.name}: the same drawn again, values that differ", 0.0, float((both != again).sum()))
        (picture,) = backend.render_views(mosaic, ARRAY, VIEWS[1:])
        yield Found(
            f"{backend.name}: seams through the samples' places, holes", 0.0, float((picture[..., 3] == 0).sum())
        )


def cut_outs(effort: Effort) -> Iterator[Found | Skipped]:
    """Places up to 31 fully cut-away sheets close behind one another, in front of one that is visible."""
    backends, skipped = open_backends("cut-outs")
    yield from skipped
    for backend in backends:
        for count in (31,) if effort.quick else (1, 8, 31):
            for slope in (0.0, 0.5):
                gap = PASSED * 60.0
                clear = [
                    shapes.make_sheet(30 + gap * i, 60.0, shapes.RED, slope=slope, cutoff=0.5) for i in range(count)
                ]
                solid = shapes.make_sheet(30 + gap * count, 60.0, shapes.GREEN, slope=slope)
                wrong = _count_wrong_pixels(backend, Scene((*clear, solid)), ARRAY, shapes.GREEN)
                what = f"{backend.name}: {count} cut-outs {gap:.2g} apart, slope {slope:g}"
                yield Found(f"{what}, pixels that do not show the sheet behind", 0.0, wrong)


def see_through(effort: Effort) -> Iterator[Found | Skipped]:
    """Places up to 63 sheets that each hide a twentieth close behind one another, and crossing triangles behind the
    array, centred on it and in front of it.
    """
    backend = open_backend("raytrace")[0]
    for count in (63,) if effort.quick else (1, 8, 63):
        gap = PASSED * 60.0
        thin = [
            replace(sheet, colors=shapes.add_alpha(sheet.colors[:, :3], 0.05), is_see_through=True)
            for sheet in (shapes.make_sheet(30 + gap * i, 60.0, shapes.RED, slope=0.5) for i in range(count))
        ]
        scene = Scene((*thin, shapes.make_sheet(30 + gap * count, 60.0, shapes.GREEN, slope=0.5)))
        truth = 255.0 * np.array([1 - 0.95**count, 0.95**count, 0.0, 1.0])
        worst = max(float(np.abs(picture - truth).max()) for picture in backend.render_views(scene, ARRAY, VIEWS))
        yield Found(f"raytrace: {count} see-through sheets {gap:.2g} apart, levels", RAY_LEVELS, worst)
    for distance in (SIDE, 0.0, -SIDE):
        soup = shapes.make_soup(20 if effort.quick else 100, side=1.5 * SIDE, distance=distance, alpha=(0.05, 0.6))
        pictures = list(backend.render_views(soup, ARRAY, VIEWS))
        found = compare(pictures, VIEWS, ARRAY, build_slow_sight(soup), allowed=RAY_LEVELS, band=FLOAT_BAND)
        what = f"raytrace against float64: see-through triangles at {distance:g}, worst colour, levels"
        yield Found(what, RAY_LEVELS, found.worst, found.at)


def degenerate(effort: Effort) -> Iterator[Found | Skipped]:
    """Checks that triangles without area change no bit of a picture, and vertices that are not numbers are refused."""
    ball = make_ball(12 if effort.quick else 60)
    corners = len(ball.vertices)
    flat = np.array([[0, 0, 1], [2, 2, 2], [corners, corners + 1, corners + 2]])  # the last one: three points on a line
    line = np.array([[0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [0.2, 0.4, 0.6]])
    extended = Surface(np.concatenate([ball.vertices, line]), np.concatenate([flat, ball.faces, flat[::-1]]))
    clean, dirty = (assemble_scene([surface], name="ball") for surface in (ball, extended))
    backends, skipped = open_backends("triangles without area")
    yield from skipped
    for backend in backends:
        one, other = (
            next(iter(backend.render_views(s.transform(frame_scene(s, ARRAY)), ARRAY, VIEWS))) for s in (clean, dirty)
        )
        yield Found(f"{backend.name}: triangles without area, values that differ", 0.0, float((one != other).sum()))
    noted = sum("6 of" in note and "zero area" in note for note in dirty.notes)
    yield Found("triangles without area, without a note", 0.0, float(1 - noted))
    for value, text in ((np.nan, "NaN or infinite"), (np.inf, "NaN or infinite"), (-1e12, "a coordinate is 1e+12")):
        vertices = ball.vertices.copy()
        vertices[ball.faces[3, 1], 2] = value
        yield Found(f"a vertex at {value:g}, let through", 0.0, _let_through(vertices, ball.faces, text))
    none = _let_through(ball.vertices, np.repeat(ball.faces[:, :1], 3, axis=1), "zero area")
    yield Found("no triangle with an area, let through", 0.0, none)


def make_ball(rings: int) -> Surface:
    """Makes a unit sphere with its poles left open."""
    from ciir.renderer.scenes.modelling import revolve

    turn = np.linspace(-1.5, 1.5, rings)
    vertices, faces, _ = revolve(np.column_stack([np.cos(turn), np.sin(turn)]), 2 * rings)
    return Surface(vertices, faces)


def _let_through(vertices: NDArray[np.float64], faces: NDArray[np.int64], text: str) -> float:
    """Returns 0 if the mesh is refused in one line that contains `text`; 1 otherwise."""
    try:
        assemble_scene([Surface(vertices, faces)], name="broken")
    except InvalidGeometry as error:
        return float(text not in str(error) or "\n" in str(error))
    return 1.0


CASES: tuple[Case, ...] = (depth_order, depth_order_by_lens, coplanar, cut_outs, see_through, degenerate)
