"""Every view holds the whole object, which is as large as that allows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.renderer.framing import CLEARANCE, FILL, find_extremes, frame_scene, make_frame
from ciir.renderer.lens_array import LensArray
from ciir.renderer.placement import Placement
from ciir.renderer.scene import Part, Scene, Window


def cloud(seed, stretch):
    random = np.random.default_rng(seed)
    vertices = random.normal(size=(30, 3)) * stretch + random.normal(size=3) * 10
    return Scene((Part(vertices, np.arange(30, dtype=np.int32).reshape(-1, 3), np.ones((30, 4), np.float32)),))


@settings(max_examples=60)
@given(
    st.integers(0, 1000),
    st.tuples(*[st.sampled_from([1e-6, 0.01, 1.0, 300.0])] * 3),
    st.sampled_from([(1, 1, 1, 1), (50, 50, 15, 15), (30, 80, 5, 9), (2, 3, 64, 48)]),
    st.sampled_from([1.0, 0.02, 500.0]),
    st.tuples(st.sampled_from([-1.0, -0.3, 0.0, 1.0]), st.sampled_from([1.0, 0.25, 3.0])),
)
def test_every_view_holds_the_object_and_no_larger_one_would_fit(seed, stretch, counts, pitch, placed_at):
    (place, zoom), scene, array = placed_at, cloud(seed, stretch), LensArray(*counts, pitch=pitch)
    matrix = frame_scene(scene, array, Placement(place=place, zoom=zoom, rotate=(40.0, 0.0, 0.0)))
    placed = scene.transform(matrix).parts[0].vertices
    if abs(place) == 1:
        assert (placed[:, 2] * place > 0).all()
    reach = 0.0
    for tx in array.tangent_x():
        for ty in array.tangent_y():
            across = np.abs(placed[:, 0] + tx * placed[:, 2]).max() / (array.width / 2)
            down = np.abs(placed[:, 1] + ty * placed[:, 2]).max() / (array.height / 2)
            reach = max(reach, across, down)
    # A flat cloud of 1e-6 stands 10 away from the origin: its own extent keeps 9 digits.
    assert reach == pytest.approx(zoom * FILL, rel=1e-7)


@settings(max_examples=40)
@given(
    st.integers(0, 1000),
    st.floats(0.01, 100),
    st.tuples(*[st.floats(-180, 180)] * 3),
    st.tuples(st.floats(-1, 1), st.sampled_from(["views", "none"])),
    st.sampled_from([None, Window(1.0, 4.0, 9.0, 2.0, None)]),
)
def test_a_depth_factor_scales_depth_alone(seed, factor, angles, placed, window):
    scene, array = replace(cloud(seed, (1, 2, 3)), window=window), LensArray(30, 80, 5, 9)
    placement = Placement(rotate=angles, place=placed[0], fit=placed[1])
    whole, flat = (frame_scene(scene, array, replace(placement, depth_factor=each)) for each in (1.0, factor))
    assert np.array_equal(whole, frame_scene(scene, array, placement))
    assert np.array_equal(flat[[0, 1, 3]], whole[[0, 1, 3]])
    assert np.array_equal(flat[2], factor * whole[2])


def test_orientation_and_proportions_stay():
    matrix = frame_scene(cloud(0, (1, 2, 3)), LensArray(50, 50, 15, 15))
    assert matrix[0, 0] == matrix[1, 1] == matrix[2, 2] > 0
    off_diagonal = matrix[:3, :3] - np.diag(np.diag(matrix[:3, :3]))
    assert not off_diagonal.any()


@pytest.mark.parametrize("flat", [(0, 1, 1), (1, 0, 1), (0, 0, 1), (1, 1, 0)])
def test_flat_objects_are_in_front_of_the_array(flat):
    array = LensArray(10, 10, 1, 1)
    bounds = cloud(4, (1, 2, 3)).transform(np.diag([*flat, 1.0]))
    placed = bounds.transform(frame_scene(bounds, array)).bounds()
    assert np.isfinite(placed).all()
    assert (placed[:, 2] < 0).all()
    assert np.abs(placed[:, :2]).max() <= 5.0


@pytest.mark.parametrize("axis", [0, 1])
def test_bounding_box_is_centred(axis):
    scene, array = cloud(3, (1, 2, 3)), LensArray(50, 50, 15, 15)
    bounds = scene.transform(frame_scene(scene, array)).bounds()
    assert bounds[:, axis].sum() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("place", [-1.0, -0.5, 0.0, 1.0])
@pytest.mark.parametrize("zoom", [1.0, 2.0])
def test_the_bounding_box_lies_behind_astride_or_before_the_array(place, zoom):
    scene, array = cloud(3, (1, 2, 3)), LensArray(50, 50, 15, 15)
    low, high = scene.transform(frame_scene(scene, array, Placement(place=place, zoom=zoom))).bounds()
    sides = high - low
    assert low[2] + high[2] == pytest.approx(place * (sides[2] + 2 * CLEARANCE * sides.max()))


@settings(max_examples=30)
@given(st.integers(0, 1000), st.tuples(*[st.floats(-180, 180)] * 3), st.floats(-1, 1))
def test_scenes_are_framed_together_by_their_extremes(seed, angles, place):
    scenes, array = [cloud(seed, (1, 2, 3)), cloud(seed + 1, (3, 1, 1))], LensArray(30, 80, 5, 9)
    placement = Placement(rotate=angles, place=place)
    framed = make_frame([find_extremes(scene, array, placement, np.eye(4)) for scene in scenes], [None, None])
    both = Scene(scenes[0].parts + scenes[1].parts)
    together = frame_scene(replace(scenes[0], framed=framed), array, placement)
    assert together == pytest.approx(frame_scene(both, array, placement), rel=1e-12)


def test_a_scene_that_is_not_fitted_is_only_turned_and_zoomed():
    matrix = frame_scene(cloud(5, (1, 2, 3)), LensArray(10, 10, 3, 3), Placement(fit="none"))
    assert np.array_equal(matrix, np.eye(4))
    turned = frame_scene(cloud(5, (1, 2, 3)), LensArray(10, 10, 3, 3), Placement("z", zoom=2.0, fit="none"))
    assert turned @ [1, 2, 3, 1] == pytest.approx([2, 6, -4, 1])
