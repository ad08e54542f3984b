import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.displays.quilt import QuiltLayout, QuiltName, join_views, parse_json, parse_name, split_quilt

PORTRAIT = QuiltLayout(8, 6, 0.75)


def test_views_run_from_the_bottom_left_to_the_right_and_upwards():
    quilt = join_views(np.arange(6, dtype=np.uint8).reshape(6, 1, 1, 1), QuiltLayout(3, 2, 1.0))
    assert quilt[..., 0].tolist() == [[3, 4, 5], [0, 1, 2]]


@given(st.tuples(st.integers(1, 7), st.integers(1, 7)), st.tuples(*[st.integers(1, 4)] * 3), st.integers(0, 3))
def test_split_is_the_inverse_of_join(grid, size, margin):
    cols, rows = grid
    layout = QuiltLayout(cols, rows, 1.0)
    views = np.random.default_rng(0).integers(0, 65536, (cols * rows, *size), np.uint16)
    quilt = np.pad(join_views(views, layout), ((margin % rows, 0), (0, margin % cols), (0, 0)))
    assert np.array_equal(split_quilt(quilt, layout, name="q.png"), views)


def test_columns_come_first_in_the_name():
    assert parse_name(f"duck{PORTRAIT.suffix}.png") == QuiltName(8, 6, 0.75)
    assert PORTRAIT.suffix == "_qs8x6a0.75"
    assert parse_name("a/b_QS11x6a0.5625.JPG") == QuiltName(11, 6, 0.5625)
    assert parse_name("duck.png") is None


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("Jane_Guan_Space_Nap_qs8x6.webp", (8, 6, None)),
        ("Jane_Guan_Space_Nap_qs8x6_qs5x9a1.6.png", (5, 9, 1.6)),
        ("a_qs5x9a1.6_qs8x6.png", (8, 6, None)),
        ("a_qs8x6 (1).png", (8, 6, None)),
        ("a_qs8x6b.png", None),
        ("a_qs8x6000.png", None),
        ("a_qs8x6/b.png", None),
    ],
)
def test_the_last_layout_in_a_name_counts_and_may_have_no_aspect(name, found):
    assert parse_name(name) == (found and QuiltName(*found))


def test_a_layout_without_an_aspect_is_completed():
    assert (QuiltName(8, 6).suffix, QuiltName(8, 6, 0.75).suffix) == ("_qs8x6", "_qs8x6a0.75")
    assert QuiltName(8, 6).complete(0.75) == QuiltName(8, 6, 0.75).complete(2.0) == PORTRAIT
    with pytest.raises(InvalidOption, match="quilt: 99x6 is out of range"):
        QuiltName(99, 6)


@given(st.integers(1, 64), st.integers(1, 64), st.floats(0.01, 100))
def test_a_name_holds_the_layout(cols, rows, aspect):
    found = parse_name(f"x{QuiltLayout(cols, rows, aspect).suffix}.png")
    assert (found.cols, found.rows) == (cols, rows)
    assert found.aspect == pytest.approx(aspect, rel=1e-5)


def test_the_json_beside_it_holds_the_layout():
    text = PORTRAIT.to_json()
    assert parse_json(text.encode(), name="j") == PORTRAIT
    assert parse_json(json.dumps({"quilt_settings": json.loads(text)}).encode(), name="j") == PORTRAIT
    inverted = parse_json(text.replace("false", "true").encode(), name="j")
    assert inverted.is_inverted
    quilt = np.random.default_rng(3).integers(0, 256, (12, 16, 3), np.uint8)
    assert np.array_equal(split_quilt(quilt, inverted, name="q"), split_quilt(quilt, PORTRAIT, name="q")[::-1])
    assert json.loads(text) == {"viewX": 8, "viewY": 6, "viewTotal": 48, "aspect": 0.75, "invertViews": False}


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"viewX": "x", "viewY": 1, "aspect": 1}', "[" * 9999])
def test_other_json_is_refused(text):
    with pytest.raises(Unreadable, match=r"^j: not a quilt's layout; give JSON with viewX"):
        parse_json(text.encode(), name="j")


@pytest.mark.parametrize(("cols", "rows", "aspect"), [(0, 6, 1.0), (8, 65, 1.0), (8, 6, 0.0), (8, 6, float("nan"))])
def test_layouts_out_of_range_are_refused(cols, rows, aspect):
    with pytest.raises(InvalidOption, match="out of range; give"):
        QuiltLayout(cols, rows, aspect)


def test_a_quilt_smaller_than_its_layout_is_refused():
    with pytest.raises(InvalidOption, match=r"^q.png: 7x6 pixels \(width x height\) are too few for 8x6 views"):
        split_quilt(np.zeros((6, 7, 3), np.uint8), PORTRAIT, name="q.png")
