import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.displays.devices import DEVICES, find_device
from ciir.renderer.displays.rays import RayCaster
from ciir.renderer.displays.screen import Screen, place_views
from ciir.renderer.scene import Part, Scene


def make_square(x, y, z, side, color):
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * side / 2 + [x, y, z]
    return Part(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.tile(np.float32([*color, 1]), (4, 1)))


def find_middles(view, channel):
    rows, columns = np.nonzero(view[..., channel] > 128)
    return columns.mean() + 0.5, rows.mean() + 0.5


@pytest.fixture(scope="module")
def views():
    """A red square before the screen, a green one in its plane above, a blue one behind it below."""
    scene = Scene(
        (
            make_square(0.1, 0.0, 0.3, 0.1, (1, 0, 0)),
            make_square(0.0, 0.3, 0.0, 0.1, (0, 1, 0)),
            make_square(-0.1, -0.3, -0.4, 0.1, (0, 0, 1)),
        )
    )
    return list(Screen(0.75, 40.0).render_views(RayCaster(scene), 5, (400, 300)))


def test_the_distance_follows_from_the_field_of_view():
    assert Screen(0.75).distance == pytest.approx(4.0722, abs=1e-4)
    assert Screen(0.75, 40.0, 90.0).distance == pytest.approx(0.5)


def test_points_project_by_similar_triangles(views):
    screen = Screen(0.75, 40.0)
    for view, angle in zip(views, np.radians([-20, -10, 0, 10, 20]), strict=True):
        camera = screen.distance * np.tan(angle)
        for channel, (x, y, z) in enumerate([(0.1, 0.0, 0.3), (0.0, 0.3, 0.0), (-0.1, -0.3, -0.4)]):
            share = screen.distance / (screen.distance - z)
            seen_x, seen_y = camera + (x - camera) * share, y * share
            expected = (seen_x / 0.75 + 0.5) * 300, (0.5 - seen_y) * 400
            assert find_middles(view, channel) == pytest.approx(expected, abs=0.51)


def test_the_first_camera_is_the_leftmost(views):
    """From the left, what is near lies further to the right before what is far."""
    first, last = ([find_middles(view, channel)[0] for channel in (0, 1, 2)] for view in (views[0], views[-1]))
    assert first[0] > last[0] + 20
    assert first[1] == pytest.approx(last[1], abs=0.01)
    assert first[2] < last[2] - 20


def test_cameras_are_not_toed_in(views):
    """A square parallel to the screen stays a square: no keystone, no vertical parallax."""
    for channel in (0, 1, 2):
        heights = [find_middles(view, channel)[1] for view in views]
        assert np.ptp(heights) < 0.01
        for view in views:
            rows, columns = np.nonzero(view[..., channel] > 128)
            assert len(rows) == (np.ptp(rows) + 1) * (np.ptp(columns) + 1)


def test_samples_are_averaged():
    scene = Scene((make_square(0, 0, 0, 1.0, (1, 1, 1)),))
    (view,) = Screen(2.0).render_views(RayCaster(scene), 1, (3, 6), samples=4)
    assert np.unique(view).tolist() == [0, 128, 255]


def test_a_single_camera_stands_in_the_middle():
    assert place_views(1).tolist() == [0.5]
    assert place_views(3).tolist() == [0, 0.5, 1]


def test_the_lens_array_for_framing_has_the_screens_size_and_directions():
    array = Screen(0.75, 40.0).lens_array()
    assert (array.width, array.height) == pytest.approx((0.75, 1.0))
    assert array.tangent_x().max() == pytest.approx(np.tan(np.radians(20)))
    assert array.tangent_y().max() >= np.tan(np.radians(7))


@pytest.mark.parametrize("cone", [0, -5, 121, float("nan")])
def test_cones_out_of_range_are_refused(cone):
    with pytest.raises(InvalidOption, match="give more than 0, at most 120"):
        Screen(1.0, cone)


@pytest.mark.parametrize("name", DEVICES)
def test_devices_have_whole_tiles_of_about_their_aspect(name):
    device = find_device(name)
    height, width = device.tile
    assert height * device.layout.rows == device.height
    assert width * device.layout.cols == device.width
    assert 0.4 < width / height / device.layout.aspect < 1.7  # tiles may be anamorphic


def test_an_unknown_device_is_refused_with_the_known_ones():
    with pytest.raises(InvalidOption, match="device: 'phone' is not known; give portrait, go, 16-landscape"):
        find_device("phone")
