import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.views import Pickup
from tests.support.light_fields import make_views

SIDES = st.integers(1, 6)
SETTINGS = settings(max_examples=80)


def picture(height: int, width: int, channels: int, dtype: type) -> np.ndarray:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, (height, width, channels), dtype=dtype)


@SETTINGS
@given(
    sides=st.tuples(SIDES, SIDES, SIDES, SIDES),
    channels=st.integers(1, 4),
    dtype=st.sampled_from([np.uint8, np.uint16]),
    pickup=st.sampled_from(["virtual", "optical"]),
)
def test_pixel_mapping_and_back(sides: tuple[int, int, int, int], channels: int, dtype: type, pickup: Pickup) -> None:
    rows, cols, pixels_v, pixels_u = sides
    eia = picture(rows * pixels_v, cols * pixels_u, channels, dtype)
    field = LightField.from_eia(eia, rows=rows, cols=cols, pickup=pickup)
    assert field.views.shape == (pixels_v, pixels_u, rows, cols, channels)
    for v in range(pixels_v):
        for u in range(pixels_u):
            row, column = (v, u) if pickup == "virtual" else (pixels_v - 1 - v, pixels_u - 1 - u)
            assert np.array_equal(field.views[v, u], eia[row::pixels_v, column::pixels_u])
    back = field.eia(pickup=pickup)
    assert back.dtype == dtype
    assert np.array_equal(back, eia)


@pytest.mark.parametrize("pickup", ["virtual", "optical"])
def test_views_are_no_copy(pickup: Pickup) -> None:
    eia = picture(12, 20, 3, np.uint8)
    field = LightField.from_eia(eia, rows=3, cols=4, pickup=pickup)
    assert np.shares_memory(field.views, eia)
    assert field.views.base is not None
    eia[:] = 7
    assert (field.views == 7).all()


def test_an_optical_pickup_rotates_each_elemental_image_by_180_degrees() -> None:
    eia = picture(6, 10, 3, np.uint16)
    turned = LightField.from_eia(eia, rows=2, cols=2).eia(pickup="optical")
    for y in (0, 1):
        for x in (0, 1):
            block = np.s_[3 * y : 3 * y + 3, 5 * x : 5 * x + 5]
            assert np.array_equal(turned[block], np.rot90(eia[block], 2))


@pytest.mark.parametrize(("rows", "cols"), [(5, 4), (4, 3), (0, 4), (4, 0), (-4, 4), (13, 4)])
def test_a_lens_grid_that_does_not_divide_the_picture(rows: int, cols: int) -> None:
    with pytest.raises(InvalidOption, match=f"^lenses: {rows}x{cols} does not divide the picture of 12x20 pixels .*;"):
        LightField.from_eia(picture(12, 20, 3, np.uint8), rows=rows, cols=cols)


def test_refocusing_keeps_the_type_of_the_pixels() -> None:
    views = np.random.default_rng(5).integers(0, 65536, (3, 3, 20, 24, 4), dtype=np.uint16)
    views[..., 3] = 65535
    light_field = LightField(views)
    plane = light_field.refocus(0.0)
    assert (plane.dtype, plane.shape) == (np.uint16, (20, 24, 4))
    assert np.abs(plane - views.mean(axis=(0, 1))).max() <= 0.52  # rounding, and float32 sums of 16 bit
    assert np.array_equal(light_field.refocus(1.5, aperture=0.5), views[1, 1])  # the middle view alone is not shifted
    assert light_field.disparity().disparity.shape == (20, 24)


def test_refocusing_takes_one_number() -> None:
    light_field = LightField(np.random.default_rng(5).integers(0, 256, (3, 3, 20, 24, 3), dtype=np.uint8))
    assert np.array_equal(light_field.refocus(np.array(0.5)), light_field.refocus(0.5))
    for several, kind in ((np.array([1.0]), "ndarray"), ([0.5, 1], "list")):
        with pytest.raises(InvalidOption, match=f"^disparity: {kind} is not one number; .*planes"):
            light_field.refocus(several)  # type: ignore[arg-type]


@pytest.mark.parametrize("order", ["<", ">"])
def test_any_byte_order_is_taken(order: str) -> None:
    views = np.arange(2 * 2 * 4 * 4 * 3, dtype=f"{order}u2").reshape(2, 2, 4, 4, 3)
    found = LightField(views)
    assert found.dtype.isnative
    assert np.array_equal(found.views, views)
    with pytest.raises(InvalidOption, match="float32 is not accepted"):
        LightField(views.astype(f"{order}f4"))


@pytest.mark.parametrize(
    ("most", "kind", "advice"),
    [
        (1, float, "(255 * views).round().astype('u1')"),
        (1.004, float, "in (255 * views.clip(0, 1)).round().astype('u1')"),
        (2, float, "in (255 * views.clip(0, 1)).round().astype('u1')"),
        (255, float, "in views.round().astype('u1')"),
        (255.8, np.float32, "in views.clip(0, 255).round().astype('u1')"),
        (300, np.int64, "in views.round().astype('u2')"),
        (255, np.int64, "in views.round().astype('u1')"),
        (65535, float, "in views.round().astype('u2')"),
        (70000, float, "in views.clip(0, 65535).round().astype('u2')"),
        (np.nan, float, "in (255 * np.nan_to_num(views).clip(0, 1)).round().astype('u1')"),
        (np.inf, float, "in (255 * views.clip(0, 1)).round().astype('u1')"),
        (1, bool, "in (255 * views).round().astype('u1')"),
        (1j, complex, "in (255 * np.abs(views)).round().astype('u1')"),
        (200 + 3j, complex, "in np.abs(views).round().astype('u1')"),
        ("12", str, "in views.astype('u1')"),
    ],
)
def test_the_advice_for_other_types_fits_the_numbers(most: float, kind: type, advice: str) -> None:
    """255 times levels of 8 bits would overflow."""
    with pytest.raises(InvalidOption, match=re.escape(advice)):
        LightField(np.full((2, 2, 4, 4, 3), most, kind))


@pytest.mark.parametrize("occluders", ["keep", "remove"])
@pytest.mark.parametrize("disparity", [999, -24.5])
def test_disparities_without_overlap_are_refused(disparity, occluders):
    field = LightField(np.full((3, 3, 20, 24, 3), 9, np.uint8))
    message = f"disparity: {abs(disparity):g} pixels are over the 24 of a view, so that no views overlap; give less"
    with pytest.raises(InvalidOption, match=message):
        field.refocus(disparity, occluders=occluders)
    assert field.refocus(24.0, occluders=occluders).any()
    assert list(field.planes([])) == []


@pytest.mark.parametrize("occluders", ["keep", "remove"])
def test_disparities_are_any_numbers(occluders):
    field = LightField(np.random.default_rng(0).integers(0, 256, (3, 3, 8, 8, 1), np.uint8))

    class Tensor:
        def __array__(self, dtype=None, copy=None):
            return np.array([0, 0.5], np.float32)

    expected = list(field.planes([0, 0.5], occluders=occluders))
    for disparities in ((each / 2 for each in range(2)), Tensor(), {0: "a", 0.5: "b"}, np.array([0, 0.5])):
        np.testing.assert_array_equal(list(field.planes(disparities, occluders=occluders)), expected)
    for wrong in (0.5, None, "0.5", [[0.5], [0, 0.5]], [0.5j], [float("nan")]):
        with pytest.raises(InvalidOption, match=r"disparities: give finite numbers, in pixels per view, such as \["):
            field.planes(wrong, occluders=occluders)


def test_planes_that_are_not_rounded():
    field = LightField(np.random.default_rng(0).integers(0, 256, (3, 3, 8, 8, 1), np.uint8))
    exact = field.refocus(0.5, rounded=False)
    assert exact.dtype == np.float32
    assert (exact % 1 != 0).any()
    np.testing.assert_array_equal(np.rint(exact).clip(0, 255), field.refocus(0.5))


@pytest.mark.parametrize("sense", ["lenses", "cameras"])
def test_flipping_reverses_views_and_in_u_the_depth_sense(sense):
    views = np.arange(2 * 3 * 4 * 5, dtype=np.uint8).reshape(2, 3, 4, 5, 1)
    field = LightField(views, ("note",), depth_sense=sense)
    other = {"lenses": "cameras", "cameras": "lenses"}[sense]
    for axes, expected, depth_sense in (
        ("none", views, sense),
        ("u", views[:, ::-1], other),
        ("v", views[::-1], sense),
        ("uv", views[::-1, ::-1], other),
    ):
        flipped = field.flip(axes)
        assert np.array_equal(flipped.views, expected)
        assert (flipped.depth_sense, flipped.notes) == (depth_sense, ("note",))
        assert np.shares_memory(flipped.views, views)
    assert np.array_equal(field.transpose().views, views.swapaxes(0, 1))
    assert field.transpose().depth_sense == sense


def test_after_a_flip_of_one_axis_and_after_a_transposition_the_order_is_unknown():
    for is_ordered in (True, False):
        field = LightField(np.zeros((3, 4, 2, 2, 3), np.uint8), is_ordered=is_ordered)
        assert field.flip("uv").is_ordered == field.flip("none").is_ordered == is_ordered
        assert not any(other.is_ordered for other in (field.flip("u"), field.flip("v"), field.transpose()))


def test_near_content_moves_as_the_depth_sense_says_after_a_flip():
    # A point one pixel further right in each view to the right: near in a lens array, far in a camera array.
    views = np.zeros((3, 3, 9, 9, 1), np.uint8)
    for v, u in np.ndindex(3, 3):
        views[v, u, 3 + v, 3 + u] = 255
    near = LightField(views, depth_sense="lenses").flip("uv")
    assert near.depth_sense == "cameras"
    assert [int(near.view(1, u).argmax()) % 9 for u in range(3)] == [5, 4, 3]  # to the left: near for cameras too


def test_options_that_are_not_known_are_refused(tmp_path):
    field = LightField(np.zeros((1, 2, 3, 4, 3), np.uint8))
    message = "'screen': no such option; the options are device, quilt, aspect, .*, path, frames, fps, epi"
    for options in ({"screen": "p.toml"}, {"device": "go", "screen": "p.toml"}):
        with pytest.raises(InvalidOption, match=message):
            field.save(tmp_path / "a.png", "quilt", **options)
    with pytest.raises(InvalidOption, match="disparity: 'a' is not a number; give pixels per view"):
        field.refocus("a")
    with pytest.raises(InvalidOption, match="disparity: 'True' is not a number"):
        field.refocus(True)
    with pytest.raises(InvalidOption, match="aperture: 'a' is not a number; give a radius in views"):
        field.refocus(np.float32(0.5), aperture="a")


def test_slices_take_a_part_and_keep_the_rest():
    views = np.arange(5 * 4 * 6 * 7, dtype=np.uint8).reshape(5, 4, 6, 7, 1)
    field = LightField(views, ("note",), is_ordered=True, depth_sense="cameras")
    part = field[1:4, :2, ::2, 2:]
    np.testing.assert_array_equal(part.views, views[1:4, :2, ::2, 2:])
    assert (part.depth_sense, part.is_ordered, part.notes) == ("cameras", True, ("note",))
    assert np.shares_memory(part.views, views)
    np.testing.assert_array_equal(field[3:].views, views[3:])


@pytest.mark.parametrize(
    ("slices", "aspect"), [(np.s_[1:, ::2, 1:, 2:], 1.5), (np.s_[:, :, ::2], 0.75), (np.s_[:, :, ::2, ::4], 3.0)]
)
def test_pixels_that_slices_leave_out_change_the_pixel_aspect(slices, aspect):
    field = LightField(np.zeros((2, 2, 8, 8, 1), np.uint8), pixel_aspect=1.5)
    assert field[slices].pixel_aspect == aspect
    assert field.flip("u").transpose().with_depth_sense("cameras").pixel_aspect == 1.5


@pytest.mark.parametrize("aspect", [0, -1, float("nan"), float("inf"), True, None, "2"])
def test_pixel_aspects_out_of_range_are_refused(aspect):
    with pytest.raises(InvalidOption, match=r"pixel_aspect: .* is not a width / height of a pixel; give one"):
        LightField(np.zeros((2, 2, 8, 8, 1), np.uint8), pixel_aspect=aspect)


@pytest.mark.parametrize(
    "wrong", [0, (0, 0), (), np.s_[::-1], np.s_[::0], np.s_[::1.5], np.s_["a":], np.s_[:, :, :, :, :1], None, "v"]
)
def test_what_is_no_part(wrong):
    with pytest.raises(InvalidOption, match="light field: give one to four slices that go forwards"):
        LightField(np.zeros((2, 2, 3, 3, 1), np.uint8))[wrong]


def test_a_part_without_views_is_refused():
    with pytest.raises(InvalidOption, match=r"shape \(0, 2, 3, 3, 1\) is not accepted"):
        LightField(np.zeros((2, 2, 3, 3, 1), np.uint8))[2:]


def test_numpy_takes_the_views():
    field = LightField(np.full((2, 2, 3, 3, 1), 200, np.uint8))
    assert np.shares_memory(np.asarray(field), field.views)
    np.testing.assert_array_equal(np.asarray(field, np.float32), field.views.astype(np.float32))


def test_notes_are_counted_where_it_is_shown():
    views = np.zeros((1, 2, 3, 4, 3), np.uint8)
    shown = "LightField(1x2 views of 3x4 pixels, 3 channels, uint8, depth sense lenses"
    assert [repr(LightField(views, ("a", "b", "c")[:count])) for count in range(3)] == [
        f"{shown})",
        f"{shown}, 1 note)",
        f"{shown}, 2 notes)",
    ]


@pytest.mark.parametrize("sense", ["camera", "Cameras", "auto", None, []])
def test_an_unknown_depth_sense_is_refused(sense):
    views = np.zeros((1, 2, 3, 4, 3), np.uint8)
    for make in (lambda: LightField(views, depth_sense=sense), lambda: LightField(views).with_depth_sense(sense)):
        with pytest.raises(InvalidOption, match=r"depth_sense: .* is not known; give cameras or lenses"):
            make()


@pytest.mark.parametrize("axes", ["U", "vu", "", None, 1])
def test_unknown_axes_are_not_flipped(axes):
    with pytest.raises(InvalidOption, match=r"flip: .* is not known; give none, u, v, uv"):
        LightField(np.zeros((2, 2, 3, 4, 3), np.uint8)).flip(axes)


@pytest.mark.parametrize("index", [2, -1, 0.0, 1.5, "1", True, None])
def test_a_view_is_named_by_whole_numbers(index):
    field = LightField(np.zeros((2, 2, 3, 4, 3), np.uint8))
    for pair in ((index, 0), (0, index)):
        with pytest.raises(InvalidOption, match="is not there; v goes from 0 to 1 and u from 0 to 1"):
            field.view(*pair)
    assert field.view(np.int64(1), np.uint8(0)).shape == (3, 4, 3)


@pytest.mark.parametrize("line", [3, -1, 1.5, "a", True])
def test_an_epi_is_named_by_a_whole_number(line):
    with pytest.raises(InvalidOption, match=r"epi: there is no y=.*; give 0 to 2"):
        LightField(np.zeros((2, 2, 3, 4, 3), np.uint8)).epi(y=line)


def test_a_grey_array_has_one_channel():
    eia = picture(6, 8, 1, np.uint8)
    grey = LightField.from_eia(eia[..., 0], rows=np.int64(3), cols=2)
    np.testing.assert_array_equal(grey.views, LightField.from_eia(eia, rows=3, cols=2).views)


@pytest.mark.parametrize(
    ("eia", "rows", "words"),
    [
        ([[1]], 1, "eia: list is not accepted; give an array"),
        (np.zeros((0, 4, 3), np.uint8), 1, r"eia: an array of shape \(0, 4, 3\) is not accepted"),
        (np.zeros(4, np.uint8), 1, r"eia: an array of shape \(4,\) is not accepted"),
        (np.zeros((4, 4, 3), np.uint8), 2.0, "lenses: 2.0 and 2 are not whole numbers"),
        (np.zeros((4, 4, 3), np.uint8), True, "lenses: True and 2 are not whole numbers"),
    ],
)
def test_what_is_no_elemental_image_array(eia, rows, words):
    with pytest.raises(InvalidOption, match=words):
        LightField.from_eia(eia, rows=rows, cols=2)


@pytest.mark.parametrize("path", ["", None, 3, b"x"])
def test_an_output_has_a_name(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidOption, match=r"path: .* is not a name; give that of a file or a folder"):
        LightField(np.zeros((2, 2, 3, 4, 3), np.uint8)).save(path)
    assert not list(tmp_path.iterdir())


def test_an_unknown_aperture_shape_is_refused_without_an_aperture():
    with pytest.raises(InvalidOption, match="shape: 'x' is not known; give disc, square, gauss"):
        LightField(np.zeros((2, 2, 3, 4, 3), np.uint8)).refocus(0, shape="x")


@pytest.mark.parametrize(
    ("work", "total"),
    [
        (lambda field, path, progress: field.save(path / "a.npy", progress=progress), 10),
        (lambda field, path, progress: field.save(path / "a", progress=progress), 10),
        (lambda field, path, progress: list(field.planes([-1, 0, 1], progress=progress)), 3),
        (lambda field, path, progress: field.disparity(progress=progress), 1),
        (lambda field, path, progress: list(field.disparities([(0, 0), (1, 2)], progress=progress)), 2),
        (lambda field, path, progress: list(field.disparities(limits=(-1, 1), progress=progress)), 9),
        (lambda field, path, progress: field.all_in_focus(progress=progress), 1),
        (lambda field, path, progress: field.model(keeps_background=True, progress=progress), 5),
    ],
)
def test_progress_counts_to_the_total(tmp_path, work, total):
    """Those that can't be divided also report their start."""
    field = LightField(make_views((3, 3), disparities=(0, 1), side=24, channels=3), depth_sense="cameras")
    seen = []
    work(field, tmp_path, lambda *given: seen.append(given))
    assert seen == [(done, total) for done in range(0 if total == 1 else 1, total + 1)]
