import numpy as np
import pytest
from scipy import ndimage

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.writers.containers.camera_paths import draw_frames, list_positions

GRID = (5, 9)


def test_circle():
    positions = list_positions("circle", 4, GRID)
    np.testing.assert_allclose(positions, [(2, 8), (0, 4), (2, 0), (4, 4)], atol=1e-12)  # right, up, left, down


def test_sweep():
    positions = list_positions("sweep", 4, GRID)
    np.testing.assert_allclose(positions, [(2, 0), (2, 4), (2, 8), (2, 4)], atol=1e-12)


def test_spiral():
    positions = np.array(list_positions("spiral", 200, GRID))
    radii = np.hypot((positions[:, 0] - 2) / 2, (positions[:, 1] - 4) / 4)
    assert radii[0] == 0
    assert radii.argmax() == 100
    np.testing.assert_allclose(radii[1:], radii[1:][::-1], atol=1e-12)


@pytest.mark.parametrize("path", ["circle", "sweep", "spiral"])
@pytest.mark.parametrize("frames", [1, 2, 61])
def test_positions_stay_in_the_grid_and_close(path, frames):
    positions = np.array(list_positions(path, frames, GRID))
    assert positions.shape == (frames, 2)
    assert (positions >= -1e-12).all()
    assert (positions <= np.array(GRID) - 1 + 1e-12).all()
    if frames > 2:
        steps = np.abs(np.diff(positions, axis=0, append=positions[:1])).max(axis=1)
        assert steps[-1] <= steps.max() + 1e-12  # from the last to the first is a step like the others


def test_an_unknown_path():
    with pytest.raises(InvalidOption, match="path: 'square' is not known; give circle, sweep, spiral"):
        list_positions("square", 4, GRID)


def test_frames_are_the_views_at_their_positions():
    views = np.zeros((1, 3, 2, 2, 3), np.uint8)
    views[0, 1], views[0, 2] = 100, 200
    frames = [frame[0, 0, 0] for frame in draw_frames(LightField(views, depth_sense="cameras"), "sweep", 8)]
    # u = 1 - cos(pi * n / 4): 0, 0.29, 1, 1.71, 2 and back, and between views the mean by distance
    assert frames == [0, 29, 100, 171, 200, 171, 100, 29]


@pytest.mark.parametrize(("down", "across"), [(-4, 6), (6, 0)])
def test_content_between_views_is_seen_once(down, across):
    texture = ndimage.gaussian_filter(np.random.default_rng(0).random((120, 120, 3)), (1.5, 1.5, 0))
    texture = ((texture - texture.min()) / np.ptp(texture) * 255).astype(np.uint8)

    def look(v, u):
        top, left = 30 + round(v * down), 30 + round(u * across)
        return texture[top : top + 48, left : left + 56]

    views = np.array([[look(v, u) for u in range(4)] for v in range(4)])
    frame = next(draw_frames(LightField(views, depth_sense="cameras"), "spiral", 9))  # between four views
    error = (frame.astype(int) - look(1.5, 1.5))[12:-12, 12:-12]
    assert np.abs(error).mean() < 2


def test_the_camera_of_a_lens_array_starts_on_the_left_too():
    """With the depth sense of lenses the last view is that from the left."""
    views = np.zeros((1, 2, 2, 2, 3), np.uint8)
    views[0, 1] = 255
    assert next(draw_frames(LightField(views), "sweep", 4))[0, 0, 0] == 255


@pytest.mark.parametrize(
    ("depth_sense", "expected"),
    [
        ("cameras", [12, 1, 10, 21]),  # view (1, 2) on the right, then (0, 1) on top, (1, 0) and (2, 1)
        ("lenses", [10, 21, 12, 1]),  # the same places: pixels under a lens count the other way, in v too
    ],
)
def test_the_circle_goes_from_the_right_to_the_top_of_the_views(depth_sense, expected):
    views = np.broadcast_to(
        (10 * np.arange(3)[:, None] + np.arange(3)).astype(np.uint8)[..., None, None, None], (3, 3, 2, 2, 3)
    )
    frames = draw_frames(LightField(views, depth_sense=depth_sense), "circle", 4)
    assert [int(frame[0, 0, 0]) for frame in frames] == expected


@pytest.mark.parametrize(("channels", "expected"), [(1, [7, 7, 7]), (2, [7, 7, 7]), (4, [7, 107, 207])])
def test_pixels_become_rgb_of_8_bit(channels, expected):
    samples = {1: [7], 2: [7, 99], 4: [7, 107, 207, 99]}[channels]
    views = 257 * np.array(samples, np.uint16).reshape(1, 1, 1, 1, -1)
    (frame,) = draw_frames(LightField(views), "circle", 1)
    assert frame.dtype == np.uint8
    assert frame[0, 0].tolist() == expected
