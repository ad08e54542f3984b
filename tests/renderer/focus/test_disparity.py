from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.focus import disparity
from ciir.renderer.focus.disparity import _find_moved, estimate_disparity
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.view_set import reader as view_set
from tests.support.light_fields import draw_layers
from tests.support.paths import SHARED

CAPTURED = SHARED / "data/lightfields"
NEAR, FAR = 1.6, 0.4


def make_light_field(grid=(5, 5), channels=3, dtype=np.uint8, size=(72, 96)):
    """A textured square before a textured wall: by Fourier shifts of large pictures, so exact to the fraction."""
    random = np.random.default_rng(4)
    height, width = size
    wall, square = (
        ndimage.gaussian_filter(random.standard_normal((height + 32, width + 32, channels)), (1, 1, 0))
        for _ in range(2)
    )
    wall, square = (128 + 120 * picture / np.abs(picture).max() for picture in (wall, square))
    inside = np.zeros(wall.shape[:2])
    inside[36:68, 48:88] = 1
    views = np.empty((*grid, height, width, channels))
    for v, u in np.ndindex(grid):
        place = v - (grid[0] - 1) // 2, u - (grid[1] - 1) // 2
        back = ndimage.shift(wall, (-FAR * place[0], -FAR * place[1], 0), order=3, mode="wrap")
        front = ndimage.shift(square, (-NEAR * place[0], -NEAR * place[1], 0), order=3, mode="wrap")
        mask = ndimage.shift(inside, (-NEAR * place[0], -NEAR * place[1]), order=1)[..., np.newaxis]
        views[v, u] = (mask * front + (1 - mask) * back)[16:-16, 16:-16]
    true = np.where(inside[16:-16, 16:-16] > 0, NEAR, FAR)
    scale = np.iinfo(dtype).max / 255
    return LightField((scale * views.clip(0, 255)).round().astype(dtype)), true


@pytest.mark.parametrize(
    ("grid", "channels", "dtype"), [((5, 5), 3, np.uint8), ((1, 5), 1, np.uint8), ((7, 7), 4, np.uint16)]
)
def test_two_depths(grid, channels, dtype):
    light_field, true = make_light_field(grid, channels, dtype)
    found = estimate_disparity(light_field)
    error = np.abs(found.disparity - true)
    assert found.disparity.shape == found.confidence.shape == true.shape
    assert np.median(error) < 0.02  # a fiftieth of a pixel: the fit between planes that are a third apart
    assert (error > 0.07).mean() < 0.08
    is_sure = found.confidence > np.median(found.confidence)
    assert error[is_sure].mean() < error[~is_sure].mean()


@pytest.mark.parametrize("disparity", [0.06, 0.12, 0.31, 1.38])
@pytest.mark.parametrize("count", [3, 9])
def test_fractions_are_not_drawn_to_the_planes(disparity, count):
    """Planes are a quarter apart; with the fit between them alone 9x9 views gave 0.033 for 0.06."""
    found = estimate_disparity(LightField(draw_layers(disparity, count=count), depth_sense="cameras"))
    assert np.median(np.abs(found.disparity - disparity)) < 0.012
    assert found.notes == ()


def test_a_map_of_clean_views_is_corrected_by_less_than_a_plane(monkeypatch):
    right = np.s_[:, 48:]

    def move(views, view, found, *given, **options):
        moved = found + np.float32(0.01)
        moved[right] += 0.3  # planes are a quarter apart
        return moved

    light_field, _ = make_light_field()
    monkeypatch.setattr(disparity, "refine", lambda views, view, found, *given, **options: found)
    before = estimate_disparity(light_field, limits=(0, 4)).disparity
    monkeypatch.setattr(disparity, "refine", move)
    after = estimate_disparity(light_field, limits=(0, 4)).disparity
    np.testing.assert_array_equal(after[right], before[right])
    np.testing.assert_allclose(after[:, :48], before[:, :48] + 0.01, atol=1e-6)


def test_what_fits_nowhere_is_noted():
    views = draw_layers(0.5, -1.5)
    order = np.random.default_rng(1).permutation(25)
    shuffled = views.reshape(25, *views.shape[2:])[order].reshape(views.shape)
    swapped = views.copy()
    swapped[2, 2:4] = views[2, 3:1:-1]
    for wrong in (shuffled, swapped, draw_layers(40)):
        assert "% of the pixels at disparities from" in estimate_disparity(LightField(wrong)).notes[-1]
    assert estimate_disparity(LightField(views)).notes == ()


def test_something_near_that_fits_nowhere_is_noted():
    """It fills a fifth of the view, and is beyond the searched 20 pixels per view."""
    (note,) = estimate_disparity(LightField(draw_layers(2, 25, count=3), depth_sense="cameras")).notes
    assert "disparities from 1.50 to 2.75: disparities may be larger (give limits)" in note


@pytest.mark.parametrize("far", [0.05, 0.1, -0.4])
def test_disparities_between_planes_have_no_bias(far):
    """Planes are a quarter of a pixel apart."""
    found = estimate_disparity(LightField(draw_layers(far), depth_sense="cameras"))
    assert abs(found.disparity[6:-6, 6:-6].mean() - far) < 1e-3


def test_noise_does_not_count_as_what_fits_nowhere():
    views = make_light_field((9, 9))[0].views[..., :60, :]
    order = np.random.default_rng(1).permutation(81)
    shuffled = views.reshape(81, *views.shape[2:])[order].reshape(views.shape)
    for shown, is_noted in ((128 + 0.3 * (views - 128.0), False), (shuffled, True)):
        noise = np.random.default_rng(0).normal(0, 6, shown.shape)
        noisy = LightField((shown + noise).clip(0, 255).round().astype(np.uint8))
        notes = estimate_disparity(noisy, limits=(0, 2)).notes
        assert any(note.startswith("nothing fits") for note in notes) == is_noted


def test_disparities_at_the_end_of_the_search_are_noted():
    light_field = LightField(draw_layers(20), depth_sense="cameras")
    note = estimate_disparity(light_field).notes[0]
    assert note.startswith("disparities are searched up to 20 pixels per view, and some reach that; give limits")
    (found,) = light_field.disparities([(2, 2)])
    assert found.notes[0] == note
    assert estimate_disparity(light_field, limits=(15, 25)).notes == ()
    near_the_end = LightField(draw_layers(-6, 6.5, size=(60, 64)), depth_sense="cameras")
    assert estimate_disparity(near_the_end).notes == ()


def test_another_view_and_given_limits():
    light_field, _ = make_light_field()
    found = estimate_disparity(light_field, (0, 4), limits=(0, 2))
    assert found.view == (0, 4)
    assert (found.planes[0], found.planes[-1]) == (0, 2)
    y, x = 36 - round(-2 * NEAR), 48 - round(2 * NEAR)  # the middle of the square, two views up and to the right
    assert found.disparity[y, x] == pytest.approx(NEAR, abs=0.05)
    for other in ([0, 4], np.array([0, 4])):
        np.testing.assert_array_equal(light_field.disparity(other, limits=(0, 2)).disparity, found.disparity)
    assert (found.disparity.dtype, found.confidence.dtype) == (np.float32, np.float32)


@pytest.mark.parametrize(("limits", "is_noted"), [((0.35, 1.65), False), ((0.1, 0.3), True), ((-0.2, 0.42), False)])
def test_a_map_lies_within_given_limits(limits, is_noted):
    """Planes are a quarter apart."""
    light_field, _ = make_light_field()
    for found in (light_field.disparity(limits=limits), *light_field.disparities([(2, 2)], limits=limits)):
        assert limits[0] <= found.disparity.min()
        assert found.disparity.max() <= limits[1]
        notes = [note for note in found.notes if note.startswith("limits: ")]
        assert len(notes) == is_noted
        assert not notes or "% of the pixels lie at 0.1 or 0.3, the ends of the given range" in notes[0]


def test_what_counts_as_noise_stays_within_given_limits():
    noise = np.random.default_rng(1).integers(0, 256, (40, 60, 1), np.uint8)
    views = np.stack([noise[:, at : at + 40] for at in range(5)])[np.newaxis]  # to the left by 1
    found = estimate_disparity(LightField(views), limits=(0, 0.5)).disparity
    assert (found >= 0).all()
    assert (found <= 0.5).all()


@pytest.mark.parametrize("axes", ["uv", "u"])
def test_reversed_views_reverse_the_sign(axes):
    light_field, _ = make_light_field((1, 5))
    found = estimate_disparity(light_field, limits=(-2, 2)).disparity
    flipped = estimate_disparity(light_field.flip(axes), limits=(-2, 2)).disparity
    assert np.median(np.abs(flipped + found)) < 1e-3


def test_every_view_has_the_planes_of_the_centre():
    light_field, _ = make_light_field((3, 3))
    centre = estimate_disparity(light_field)
    found = list(light_field.disparities())
    assert [one.view for one in found] == [(v, u) for v in range(3) for u in range(3)]
    np.testing.assert_array_equal(found[4].disparity, centre.disparity)
    for one in found:
        np.testing.assert_array_equal(one.planes, centre.planes)
        moved = np.roll(one.disparity, [round(NEAR * (at - 1)) for at in one.view], (0, 1))
        assert (np.abs(moved - centre.disparity)[8:-8, 8:-8] > 0.1).mean() < 0.12  # outlines, and what they hide


@pytest.mark.parametrize("view", [(0, 0), (1, 2), (2, 2)])
def test_views_alone_have_the_planes_that_all_have(view):
    light_field, _ = make_light_field()
    alone = estimate_disparity(light_field, view)
    (found,) = light_field.disparities([view])
    np.testing.assert_array_equal(found.planes, alone.planes)
    np.testing.assert_array_equal(found.disparity, alone.disparity)


@pytest.mark.parametrize(
    ("folder", "pattern", "view", "least", "largest"),
    [
        ("knights", "out_0[0-4]_0[0-4]_*.jpg", (0, 0), -1.5, 3),
        ("saii-5x5", "*.png", (4, 4), 1, 44),
    ],
)
@pytest.mark.skipif(not CAPTURED.is_dir(), reason="needs the captured light fields")
def test_ranges_in_corners_of_captured_light_fields(folder, pattern, view, least, largest):
    """The patterns of `knights` repeat; the floor before `saii-5x5` comes nearer below the centre view."""
    files = {path.name: path.read_bytes() for path in (CAPTURED / folder).glob(pattern)}
    order = "columns" if folder == "saii-5x5" else "rows"
    light_field = view_set.read(files, name=folder, layout=Layout(order=order)).load()
    (found,) = light_field.disparities([view])
    assert (found.planes[0], found.planes[-1]) == pytest.approx((least, largest), abs=1)


def test_it_is_shown_in_one_line():
    found = estimate_disparity(LightField(np.full((3, 3, 20, 24, 3), 9, np.uint8)))
    text = f"DisparityMap(view 1,1, 20x24 pixels, disparity {found.disparity.min():.3f} to {found.disparity.max():.3f}"
    assert repr(replace(found, notes=())) == text + ", depth sense lenses)"
    assert repr(replace(found, notes=("a", "b"))) == text + ", depth sense lenses, 2 notes)"


def test_one_view_is_refused():
    with pytest.raises(InvalidOption, match="one view shows no depth"):
        estimate_disparity(LightField(np.zeros((1, 1, 8, 8, 3), np.uint8)))


def test_flat_views_show_no_depth():
    found = LightField(np.full((5, 5, 24, 32, 3), 128, np.uint8)).disparity()
    assert not found.confidence.any()
    np.testing.assert_allclose(found.disparity, 0, atol=0.5)


@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (9, 3)])
def test_views_of_few_pixels_are_refused(shape):
    with pytest.raises(InvalidOption, match=f"views of {shape[0]}x{shape[1]} pixels show no depth; give 4x4 or more"):
        LightField(np.zeros((3, 3, *shape, 3), np.uint8)).disparity()


@pytest.mark.parametrize("view", [(-1, 0), (0, 3)])
def test_a_view_that_is_not_there_is_refused(view):
    with pytest.raises(InvalidOption, match=f"view: {view[0]},{view[1]} is not there"):
        LightField(np.zeros((3, 3, 9, 9, 3), np.uint8)).disparity(view)
    for wrong in ((1,), (1, 2, 3), 4):
        with pytest.raises(InvalidOption, match="is not a view; give its row and column"):
            LightField(np.zeros((3, 3, 9, 9, 3), np.uint8)).disparity(wrong)


def test_large_views_are_refused_before_they_are_compared(monkeypatch):
    monkeypatch.setattr("ciir.renderer.focus.disparity.MOST_COSTS", 9 * 9 * 4)
    with pytest.raises(TooLarge, match="9x9 pixels at 9 disparities are more than 324 together"):
        LightField(np.zeros((3, 3, 9, 9, 3), np.uint8)).disparity(limits=(-1, 1))
    monkeypatch.setattr("ciir.renderer.focus.disparity.find_limits", None)  # before the range is looked for, too
    with pytest.raises(TooLarge, match="views of 9x13 pixels are too large; give 108 pixels or fewer"):
        LightField(np.zeros((3, 3, 9, 13, 3), np.uint8)).disparity()


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ((1, 0), "limits: 1 to 0 is not a range"),
        ((0, np.nan), "limits: 0 to nan is not a range"),
        ((-97, 0), "limits: -97 to 0 exceeds the 96 pixels of a view; give disparities of -96 to 96"),
        ((0, np.inf), "exceeds the 96 pixels"),
        (3, "limits: 3 is not a range; give two numbers"),
        ((1,), "is not a range; give two numbers"),
        (("a", 1), "is not a range; give two numbers"),
        ((None, 1), "is not a range; give two numbers"),
        ((True, 2), "is not a range; give two numbers"),
    ],
)
def test_limits_that_are_refused(limits, message):
    light_field, _ = make_light_field((1, 2))
    with pytest.raises(InvalidOption, match=message):
        estimate_disparity(light_field, limits=limits)


def test_noise_makes_few_pixels_worse():
    """Of smooth texture: without the correction by all views 8 % of the pixels are wrong by 0.1."""
    light_field, true = make_light_field()
    views = ndimage.gaussian_filter(light_field.views.astype(float), (0, 0, 1.5, 1.5, 0))
    views = 128 + (views - 128) * (40 / views.std())
    noise = 10 * np.random.default_rng(8).standard_normal(views.shape)
    found = estimate_disparity(LightField((views + noise).clip(0, 255).round().astype(np.uint8)), limits=(0, 2))
    assert (np.abs(found.disparity - true) > 0.1).mean() < 0.05


def test_outlines_move_but_errors_beside_them_stay():
    near = np.zeros((32, 32), np.float32)
    near[:, 16:] = 2
    sharper = near.copy()
    sharper[:, 14:16] = 2
    expected = sharper != near
    sharper[10:13, 19:21] = 1  # touches no outline
    np.testing.assert_array_equal(_find_moved(near, sharper)[:, :15], expected[:, :15])
    assert not _find_moved(near, sharper)[:, 18:].any()


def test_noisy_views_take_outlines_alone_from_the_second_look(monkeypatch):
    first = np.zeros((32, 32), np.float32)
    first[:, 16:] = 2
    second = first.copy()
    second[:, 14:16] = 2  # the outline
    expected = second.copy()
    second[8:16, 24:30] = 1  # no outline of the first map is near
    maps = [first, second]
    module = "ciir.renderer.focus.disparity"
    monkeypatch.setattr(f"{module}.match", lambda cost, guide, planes: (maps.pop(0), np.ones_like(first)))
    monkeypatch.setattr(f"{module}.refine", lambda views, view, disparity, *others, **own: disparity)
    noise = np.random.default_rng(0).normal(128, 10, (3, 3, 32, 32, 3))
    found = estimate_disparity(LightField(noise.round().astype(np.uint8)), limits=(0, 2))
    assert not maps
    np.testing.assert_array_equal(found.disparity, expected)


@pytest.mark.parametrize("change", ["mirrored", "upside down", "transposed", "reversed", "shifted"])
def test_changes_with_the_light_field(change):
    light_field, _ = make_light_field()
    views = light_field.views
    disparity = estimate_disparity(light_field).disparity
    inside = np.s_[8:-8, 8:-8]  # shifted views wrap around
    changed, expected = {
        "mirrored": (views[:, ::-1, :, ::-1], disparity[:, ::-1]),
        "upside down": (views[::-1, :, ::-1], disparity[::-1]),
        "transposed": (views.transpose(1, 0, 3, 2, 4), disparity.T),
        "reversed": (views[::-1, ::-1], -disparity),
        "shifted": (shift_views(views), disparity + 1),
    }[change]
    found = estimate_disparity(LightField(changed)).disparity
    assert np.quantile(np.abs(found - expected)[inside], 0.99) < 1e-4  # sums of floats in another order


def shift_views(views):
    """Each view moved by a pixel to the left and up for each step from the centre."""
    middle = views.shape[0] // 2
    return np.array(
        [[np.roll(view, (middle - v, middle - u), (0, 1)) for u, view in enumerate(row)] for v, row in enumerate(views)]
    )


@pytest.mark.parametrize("largest", [15, 100, 127, 1000])
def test_dark_views_of_16_bits_have_the_same_disparity_alone_and_with_others(largest):
    light_field, _ = make_light_field()
    dark = LightField((light_field.views * (largest / 255)).astype(np.uint16))
    (found,) = dark.disparities([(0, 0)])
    alone = dark.disparity((0, 0))
    np.testing.assert_array_equal(found.disparity, alone.disparity)
    np.testing.assert_array_equal(found.confidence, alone.confidence)


def test_16_bits_of_which_10_are_used_have_the_disparity_of_8():
    light_field, _ = make_light_field()
    dark = LightField(light_field.views.astype(np.uint16) * 4)
    for found, want in zip(dark.disparities([(0, 0)]), light_field.disparities([(0, 0)]), strict=True):
        np.testing.assert_allclose(found.disparity, want.disparity, atol=0.02)  # 1020 of 1023 is white
