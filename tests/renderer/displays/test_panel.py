"""Panels, as an eye sees them through their lenses, against the mesh as it is seen from there."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.backends.raytrace import RaytraceBackend
from ciir.renderer.displays import panel
from ciir.renderer.displays.integral import IntegralDisplay
from ciir.renderer.displays.panel import render_panel, resample_panel
from ciir.renderer.displays.rays import RayCaster
from ciir.renderer.framing import frame_scene
from ciir.renderer.scenes import load_scene
from tests.support.displays import load_at

BACKGROUND = (40, 60, 90)
FAR = 300.0
"""From the lenses to the eye, millimetres."""
EYES = [(0, 0, FAR), (-22, 0, FAR), (22, 0, FAR), (0, 20, FAR), (15, -15, FAR + 20)]
LIMIT = 34.5
"""dB."""


def make_display(**changed):
    """A panel of 24 x 18 mm whose lenses are no whole number of pixels wide, shifted and slightly rotated."""
    numbers = {"pixel_pitch": 0.06, "lens_pitch": 0.91, "gap": 4.0, "offset": (0.1, -0.2), "rotation": 0.7}
    return IntegralDisplay(400, 300, **(numbers | {"distance": FAR} | changed))


def find_lenses(display):
    """The centres of all lenses but those at the panel's border, `(n, 2)`: all steps along the rows and across."""
    angle, reach = math.radians(display.rotation), int(max(display.size) / display.lens_pitch)
    centers = []
    for j in range(-reach, reach + 1):
        for i in range(-reach, reach + 1):
            x, y = (i, j) if display.grid == "square" else (i + 0.5 * (j % 2), j * math.sqrt(3) / 2)
            x, y = x * display.lens_pitch, y * display.lens_pitch
            x, y = x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
            centers.append((x + display.offset[0], y + display.offset[1]))
    inside = np.array(display.size) / 2 - 2 * display.lens_pitch
    return np.array([center for center in centers if (np.abs(center) < inside).all()])


def look(panel, display, eye, lenses):
    """The colour `(n, 3)` that an eye sees through each lens's centre: of the panel's point behind it on that line.

    It gets a blend of the subpixels of a colour around that point, as a lens's spot is about a pixel wide.
    """
    points = lenses + (lenses - eye[:2]) * display.gap / eye[2]
    seen = np.empty((len(lenses), 3))
    for color in range(3):
        third = (color - 1) / 3 * {"rgb": 1, "bgr": -1, "none": 0}[display.stripes]
        column = points[:, 0] / display.pixel_pitch + (display.width - 1) / 2 - third
        row = (display.height - 1) / 2 - points[:, 1] / display.pixel_pitch
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        across, down = column - left, row - top
        upper = panel[top, left, color] * (1 - across) + panel[top, left + 1, color] * across
        lower = panel[top + 1, left, color] * (1 - across) + panel[top + 1, left + 1, color] * across
        seen[:, color] = upper * (1 - down) + lower * down
    return seen


def render_directly(caster, display, eye, lenses):
    """What the mesh shows from `eye` through each lens's centre, at the panel's angular limit: the mean over directions
    that the same blend covers, a pixel to each side, weighted as it weights them.
    """
    steps = (np.arange(6) + 0.5) / 3 - 1
    total, weights = np.zeros((len(lenses), 3)), 0.0
    for step_x in steps:
        for step_y in steps:
            tangents = (lenses - eye[:2]) / eye[2] + np.array([step_x, step_y]) * display.tangent_step
            directions = np.concatenate([tangents, np.full((len(lenses), 1), -1.0)], axis=1)
            points = np.concatenate([lenses, np.zeros((len(lenses), 1))], axis=1)
            weight = (1 - abs(step_x)) * (1 - abs(step_y))
            total += weight * caster.cast(points - eye[2] * directions, directions)
            weights += weight
    return total / weights


def psnr(one, other):
    return 10 * math.log10(255**2 / np.mean((np.asarray(one, float) - other) ** 2))


def judge(name, display, *, shown=None, **options):
    """PSNR from each of the five places of the panel made for `shown`, seen through the lenses of `display`."""
    caster = RayCaster(load_at(name, display.lens_array()), BACKGROUND)
    panel, lenses = render_panel(caster, shown or display, **options), find_lenses(display)
    return [
        psnr(look(panel, display, eye, lenses), render_directly(caster, display, eye, lenses))
        for eye in np.array(EYES, float)
    ]


@pytest.mark.parametrize("grid", ["square", "hexagonal"])
@pytest.mark.parametrize("name", ["globe", "hamburger", "duck.glb"])
def test_eyes_see_the_mesh_through_the_lenses(name, grid):
    assert min(judge(name, make_display(grid=grid))) >= LIMIT


@pytest.mark.parametrize("stripes", ["bgr", "none"])
def test_eyes_see_the_mesh_with_other_subpixels(stripes):
    assert min(judge("globe", make_display(stripes=stripes))) >= LIMIT


@pytest.mark.parametrize("name", ["vase", "duck.glb"])
def test_as_picked_up_depth_is_inverted(name):
    assert min(judge(name, make_display(), conversion="none")) < LIMIT - 5


@pytest.mark.parametrize(
    "wrong",
    [{"gap": 4.8}, {"offset": (0.1, 0.2)}, {"rotation": -0.7}, {"grid": "hexagonal"}, {"lens_pitch": 0.92}],
    ids=str,
)
def test_a_panel_for_another_lens_array_fails(wrong):
    assert min(judge("globe", make_display(), shown=make_display(**wrong))) < LIMIT - 1


@pytest.fixture(scope="module")
def captured():
    """A scene behind a display that is straight and for a far viewer, its panel, and its light field."""
    display = make_display(distance=math.inf, lens_pitch=0.6, rotation=0.0, offset=(0.3, 0.3))
    array = display.lens_array()
    scene = load_scene("globe")
    scene = scene.transform(frame_scene(scene, array))
    every = list(np.ndindex(array.pixels_v, array.pixels_u))
    views = np.stack([view[..., :3] for view in RaytraceBackend().render_views(scene, array, every)])
    views = views.reshape(array.pixels_v, array.pixels_u, array.rows, array.cols, 3)
    cameras = views[::-1, ::-1]  # a lens array's views are a camera array's in the opposite order
    return display, render_panel(RayCaster(scene), display, samples=1), cameras


def test_a_light_field_makes_nearly_the_panel_of_its_mesh(captured):
    display, panel, cameras = captured
    # Lenses are where the light field's are; red and blue lie a third of a pixel beside its directions.
    assert psnr(resample_panel(cameras, display), panel) > 30
    assert psnr(resample_panel(cameras[:, ::-1], display), panel) < 20
    assert psnr(resample_panel(cameras[::-1], display), panel) < 20


def test_spoc_inverts_the_depth_of_what_is_picked_up(captured):
    display, panel, cameras = captured
    inverted = cameras[::-1, ::-1]
    assert psnr(resample_panel(inverted, display), panel) < 20
    assert psnr(resample_panel(inverted, display, conversion="none"), panel) > 30


def test_the_reference_plane_moves_the_scene_in_depth(captured):
    """A disparity moves every view by itself times the view's place: whole pixels here, so that both are the same."""
    display, _, cameras = captured
    moved = np.zeros_like(cameras[:9, :9])
    for v, u in np.ndindex(9, 9):
        moved[v, u] = np.roll(cameras[v, u], (4 - v, 4 - u), axis=(0, 1))
    inside = (slice(60, -60), slice(60, -60))
    display = replace(display, lens_pitch=0.54)  # of 9 pixels
    plain = resample_panel(cameras[:9, :9], display)
    difference = resample_panel(moved, display, disparity=1.0)[inside].astype(int) - plain[inside]
    assert np.abs(difference).max() <= 1  # a half may be rounded either way


def test_the_whole_of_a_view_fits_into_the_panel():
    display = make_display(stripes="none")
    views = np.full((3, 3, 30, 30, 1), 200, np.uint8)
    panel = resample_panel(views, display)
    columns = np.flatnonzero((panel[150] == 200).all(axis=1))
    assert np.abs(np.array([columns[0], columns[-1]]) - [50, 349]).max() <= 19  # a lens
    assert panel[150, 0].tolist() == [0, 0, 0]
    assert (panel[:, 200] == 200).all()


@pytest.mark.parametrize("size", [(30, 15), (300, 150), (15, 30), (150, 300)])
def test_pixels_that_are_not_square_keep_their_shape(size):
    """Pixels may be smaller than lenses, where they are averaged, or larger."""
    display = make_display(stripes="none", rotation=0.0)
    round_ = np.hypot(*np.meshgrid(*((np.arange(side) + 0.5) / side - 0.5 for side in size[::-1]))) < 0.3
    views = np.broadcast_to(np.where(round_, 200, 0).astype(np.uint8)[..., None], (3, 3, *size, 1))
    is_bright = resample_panel(views, display, pixel_aspect=size[0] / size[1])[..., 0] > 100
    assert abs(np.ptp(np.flatnonzero(is_bright[150])) - np.ptp(np.flatnonzero(is_bright[:, 200]))) <= 19  # a lens


def test_the_reference_plane_is_given_in_pixels_along_x(captured):
    """Of rows that are there twice, what moves by a pixel along x moves by two along y."""
    display, _, cameras = captured
    plain = resample_panel(cameras[:9, :9], display, disparity=1.0)
    doubled = resample_panel(cameras[:9, :9].repeat(2, axis=2), display, disparity=1.0, pixel_aspect=2.0)
    assert np.array_equal(doubled, plain)


def test_a_panel_smaller_than_a_lens_shows_one_pixel_of_each_view():
    display = IntegralDisplay(6, 4, pixel_pitch=0.1, lens_pitch=1.0, gap=3.0)
    assert (resample_panel(np.full((1, 3, 12, 16, 3), 90, np.uint8), display) == 90).all()


def test_lenses_of_many_pixels_make_no_more_views_than_help(monkeypatch):
    """A lens of 128 pixels. Between 64 directions, a blend is as good as a view of its own."""
    display = IntegralDisplay(640, 512, 0.1, 12.8, 40.0, stripes="none")
    rows = np.stack([np.roll(np.sin(np.arange(40) / 3), shift) for shift in (-1, 0, 1)])
    views = np.broadcast_to((128 + 100 * rows).round().astype(np.uint8)[None, :, None, :, None], (3, 3, 32, 40, 1))
    counts, exact = [], panel.interpolate_views
    monkeypatch.setattr(panel, "interpolate_views", lambda row, count: (counts.append(count), exact(row, count))[1])
    made = resample_panel(views, display).astype(int)
    assert set(counts) == {64}
    monkeypatch.setattr(panel, "MOST_DIRECTIONS", 1000)
    assert np.abs(made - resample_panel(views, display)).mean() < 0.5
    assert set(counts) == {64, 128}


def test_16_bit_views_make_a_16_bit_panel():
    panel = resample_panel(np.full((2, 2, 60, 80, 3), 50000, np.uint16), make_display())
    assert panel.dtype == np.uint16
    assert set(np.unique(panel[..., 0])) <= {50000, 0}
