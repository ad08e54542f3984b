"""The grid of views by their names: every naming, and what is refused in which words."""

from collections.abc import Callable, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import InvalidOption
from ciir.renderer.readers.view_set.grid import Grid, find_grids
from ciir.renderer.readers.view_set.numbered_names import MOST_NUMBERS

ROW_FIRST: dict[str, Callable[[int, int], str]] = {
    "ours": lambda v, u: f"view_{v:02}_{u:02}.png",
    "in a folder": lambda v, u: f"out.1/view_{v:02}_{u:02}.png",
    "NTIRE": lambda v, u: f"Bikes/View_{v}_{u}.png",
    "bare": lambda v, u: f"{v}_{u}.png",
    "epinet, from 1": lambda v, u: f"NAME2_{v + 1:02}_{u + 1:02}.png",
    "scene": lambda v, u: f"my-scene_{v}_{u}.PNG",
    "Stanford": lambda v, u: f"out_{v:02}_{u:02}_-{381 + v}.909271_{1103 - u}.376221.png",
    "Stanford, closed": lambda v, u: f"out_{v:02}_{u:02}_{381 + v}.9_{1103 - u}.3_.png",
    "Stanford, focal length": lambda v, u: f"out_{v:02}_{u:02}_381.9_1103.3_50.0_36.0.png",
    "positions in whole numbers": lambda v, u: f"out_{v:02}_{u:02}_{381 + 7 * v}_{1103 - 9 * u}.png",
    "a scene's number before": lambda v, u: f"scene_0042_{v:02}_{u:02}.png",
    "a scene's number behind": lambda v, u: f"{v:02}_{u:02}_scene_0042.png",
    "a running number before": lambda v, u: f"{100 + 5 * v + u}_{v}_{u}.png",
    "rows as folders": lambda v, u: f"row{v}/{u:03}.png",
    "letters": lambda v, u: f"r{v}c{u}.png",
    "letters, columns first": lambda v, u: f"x{u}_y{v}.png",
    "words": lambda v, u: f"column-{u}-row-{v}.png",
    "from the middle": lambda v, u: f"view_{v - 1:02}_{u - 2:02}.png",
    "hyphens": lambda v, u: f"view-{v}-{u}.png",
    "dots": lambda v, u: f"view.{v:02}.{u:02}.png",
    "positions, some whole": lambda v, u: f"out_{v}_{u}_{v * 0.5:g}_{u * 0.25:g}.png",
    "every second, a part": lambda v, u: f"{2 * v + 4}_{2 * u + 6}.png",
}


def find(files: Sequence[str], **wish: object) -> list[Grid]:
    return find_grids(sorted(files), "set", **wish)  # type: ignore[arg-type]


def message(files: Sequence[str], **wish: object) -> str:
    with pytest.raises(InvalidOption) as caught:
        find(files, **wish)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("style", ROW_FIRST)
@pytest.mark.parametrize("shape", [None, (3, 5)])
def test_the_two_numbers_that_make_a_full_grid_are_row_and_column(style, shape):
    expected = tuple(tuple(ROW_FIRST[style](v, u) for u in range(5)) for v in range(3))
    files = [file for row in expected for file in row]
    (grid,) = find(files, shape=shape)
    assert grid.files == expected
    assert grid.shape == (3, 5)


@settings(max_examples=50)
@given(
    shape=st.tuples(st.integers(2, 5), st.integers(2, 5)),
    starts=st.tuples(st.integers(0, 20), st.integers(0, 20)),
    others=st.lists(st.integers(0, 99), max_size=MOST_NUMBERS),
    place=st.integers(0, MOST_NUMBERS),
    is_column_first=st.booleans(),
)
def test_any_numbers_around_them_make_no_difference(shape, starts, others, place, is_column_first):
    rows, cols = shape

    def name(v, u):
        pair = [v + starts[0], u + starts[1]]
        numbers = [*others[:place], *(pair[::-1] if is_column_first else pair), *others[place:]]
        return "_".join(map(str, numbers)) + ".png"

    expected = tuple(tuple(name(v, u) for u in range(cols)) for v in range(rows))
    first = "column" if is_column_first else "row"
    assert find([file for row in expected for file in row], first=first)[0].files == expected


def test_a_shape_that_fits_one_way_only_says_which_number_is_the_column():
    files = [f"{u}_{v}.png" for v in range(3) for u in range(5)]
    (grid,) = find(files, shape=(3, 5))
    assert grid.files[2][4] == "4_2.png"
    assert (grid.naming, grid.transposed_naming) == (
        "in 4_0.png 4 is the column and 0 the row",
        "in 4_0.png 4 is the row and 0 the column",
    )
    assert "pixels: 5x4 is not the 5x3 grid" in message(files, shape=(5, 4))
    assert "pixels: 3x5 is not the 5x3 grid" in message(files, shape=(3, 5), first="row")


def test_positions_in_the_names_give_the_depth_sense():
    def name(v, u, step):
        return f"out_{v:02}_{u:02}_{-300.5 - v}_{500.25 + step * u}.png"

    for step, sense in ((1, "cameras"), (-1, "lenses")):
        (grid,) = find([name(v, u, step) for v in range(3) for u in range(3)])
        assert grid.depth_sense == sense
    assert find([f"{v}_{u}.png" for v in range(3) for u in range(3)])[0].depth_sense == "cameras"


def test_a_part_of_a_larger_set_and_every_second_view_are_named():
    (grid,) = find([f"view_{v}_{u}.png" for v in range(6, 9) for u in range(3, 7)])
    assert grid.naming.endswith("from (6, 3), counted from (0, 0) here)")
    (grid,) = find([f"view_{v}_{u}.png" for v in range(0, 9, 2) for u in range(0, 9, 2)])
    assert grid.naming == "in view_0_8.png 0 is the row and 8 the column (in steps of 2)"


@pytest.mark.parametrize("first", [0, 1, 7])
def test_a_single_number_fills_a_square_row_by_row(first):
    files = [f"input_Cam{first + number:03}.png" for number in range(9)]
    (grid,) = find(files)
    assert grid.files == (tuple(files[:3]), tuple(files[3:6]), tuple(files[6:]))
    (grid,) = find(files, first="column")
    assert grid.files == (tuple(files[::3]), tuple(files[1::3]), tuple(files[2::3]))


def test_pictures_with_other_names_are_counted_apart():
    files = [f"plane_{number}_d-{number}.25.png" for number in range(8)]
    said = message([*files, "plane_8_d+0.25.png"])
    assert "set: 8 pictures without rows and columns in their names (1 with other names not counted, such as pl" in said


@pytest.mark.parametrize("first", [None, "column"])
def test_a_square_that_lacks_a_few_views_is_suspected(first):
    files = [f"input_Cam{number:03}.png" for number in range(23)]  # a prime number: one row, or two less than 25
    assert "not a square number" in message(files)
    files = files[:22]
    assert "not a square number" in message(files)  # no full grid of at least 3x3
    files = [f"input_Cam{number:03}.png" for number in range(34)]
    assert "not a square number" in message(files)
    *whole, early, late = find([f"input_Cam{number:03}.png" for number in range(33)], first=first)
    assert [grid.missing for grid in whole] == [0, 0]
    assert (early.missing, late.missing) == (3, 3)
    assert early.shape == late.shape == ((6, 5) if first else (5, 6))
    assert early.files[0][0] == "input_Cam000.png"
    assert late.files[-1][-1] == "input_Cam032.png"
    assert all(not grid.missing for grid in find([f"input_Cam{number:03}.png" for number in range(32)]))


def test_a_single_number_and_a_shape():
    files = [f"IMG_{number}.png" for number in range(8, 20)]
    assert [grid.shape for grid in find(files, shape=(2, 6))] == [(2, 6), (6, 2)]
    assert [grid.shape for grid in find(files)] == [(3, 4), (4, 3)]
    assert "asks for 9 views, but set holds 12 pictures" in message(files, shape=(3, 3))


def test_a_row_of_views_is_no_square():
    files = [f"view_00_{u:02}.png" for u in range(9)]
    assert find(files)[0].files == (tuple(files),)
    assert find(files, shape=(3, 3))[0].shape == (3, 3)
    assert find([f"view_{v}_0.png" for v in range(4)])[0].shape == (4, 1)
    assert find([f"scene_2067_{number}.png" for number in range(9)])[0].shape == (3, 3)


def test_other_pictures_are_left_out_of_a_full_grid():
    cameras = [f"input_Cam{number:03}.png" for number in range(9)]
    (grid,) = find([*cameras, "objectids_highres.png", "mask.png"])
    assert grid.shape == (3, 3)
    assert grid.left_out == ("mask.png", "objectids_highres.png")
    depth = [f"depth_{number}.png" for number in range(4)]
    assert "of different kinds (input_Cam000.png, depth_0.png)" in message([*cameras, *depth])


def test_the_first_missing_view_is_named():
    files = [f"view_{v}_{u}.png" for v in range(3) for u in range(3)]
    for missing in ((1, 2), (0, 0), (2, 2)):
        others = [file for file in files if file != "view_{}_{}.png".format(*missing)]
        assert f"there is no view {missing}; add it" in message(others)
    assert "from (5, 5) to" in message(["a_5_5.png", "a_999999999_999999999.png", "a_6_5.png"])


def test_a_missing_or_doubled_number_is_named():
    cameras = [f"input_Cam{number:03}.png" for number in (0, 1, 3, 4)]
    assert "named like input_Cam000.png number 2 is missing; give all" in message(cameras)
    assert find([f"{number}_at_{7 * number**2}.png" for number in range(4)])[0].shape == (2, 2)
    assert find(cameras, shape=(2, 2))[0].files == (tuple(cameras[:2]), tuple(cameras[2:]))
    assert "two have number 1" in message(["a1.png", "a01.png", "a2.png", "a3.png"])


def test_names_that_give_no_grid():
    several = [f"frame_{t}_{v}_{u}.png" for t in range(2) for v in range(3) for u in range(3)]
    doubled = [*several, "frame_0_0_0.jpg"]
    assert message(doubled) == "set: frame_0_0_0 occurs with two suffixes; give each view once"
    assert "no two of the 3 numbers that differ in names such as frame_0_0_0.png make a full grid" in message(several)
    two_sets = [f"{folder}/{v}_{u}.png" for folder in "ab" for v in range(2) for u in range(2)]
    assert "the names are of different kinds (a/0_0.png, b/0_0.png)" in message(two_sets)
    assert "5 pictures without rows and columns" in message(["a.png", "b.png", "c.png", "d.png", "e.png"])


def test_hostile_names():
    assert "2 pictures without rows and columns" in message(["9" * 5000 + "_0.png", "0_1.png"])
    long = ["1_" * 10_000 + f"{v}_{u}.png" for v in range(2) for u in range(3)]
    assert "6 pictures without rows and columns" in message(long)
    numbers = "_".join(["{0}"] * 200)
    files = [numbers.format(number) + ".png" for number in range(9)]
    assert find(files)[0].shape == (3, 3)


def test_the_note_names_the_folders_that_tell_views_apart():
    files = [f"set/row{v}/{u}.png" for v in range(3) for u in range(3)]
    assert find(files)[0].naming == "in row0/2.png 0 is the row and 2 the column"
    assert "in 0_2.png 0 is" in find([f"set/{v}_{u}.png" for v in range(3) for u in range(3)])[0].naming
