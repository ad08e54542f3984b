"""Views in the order that was asked for, or that the pictures show; the notes name the options that would."""

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.view_set import reader
from ciir.renderer.readers.view_set.order import settle_order
from ciir.renderer.readers.view_set.view_files import Decoder
from ciir.renderer.view_order import estimate
from ciir.renderer.view_order.evidence import ORDERS
from ciir.renderer.writers.pictures import encode_png
from tests.support.light_fields import make_views, put_in, wind, write_views


def read(files, main=None, **layout):
    return inputs.read(Bundle(main or "set", main, files), Layout(**layout))


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ("reversed along one axis", "view_00_04.png 0 is the row and 4 the column, rows counted from the bottom up"),
        ("transposed", "in view_00_02.png 0 is the column and 2 the row, which fits"),
        ("transposed and reversed along one axis", "0 is the column and 2 the row, rows counted from the bottom up"),
    ],
)
def test_views_in_a_wrong_order_are_put_right(order, words):
    views = make_views((3, 5), channels=3)
    files = write_views(put_in(order, views), lambda v, u: f"view_{v:02}_{u:02}.png")
    field = read(files)
    (note,) = field.notes
    assert note.startswith("order: 3x5 views, rows x columns: in ")
    assert words in note
    assert "order given keeps" in note
    assert ("columns counted from right to left fit as well, with depth inverted" in note) == order.endswith("axis")
    assert field.is_ordered
    assert np.array_equal(field.views, views)
    assert read(files, depth_sense="lenses").depth_sense == "lenses"
    kept = read(files, order="given")
    assert kept.is_ordered
    assert [note.split(":")[0] for note in kept.notes] == ["views"]
    assert np.array_equal(kept.views, put_in(order, views))


@pytest.mark.parametrize(
    ("order", "given", "seen"),
    [
        ("columns", "as given", "transposed"),
        ("rows", "reversed along one axis", "reversed along one axis"),
        ("serpentine", "as given", "reversed in every other row"),
    ],
)
def test_an_order_that_was_asked_for_and_is_wrong_is_noted(order, given, seen):
    views = put_in(given, make_views((5, 5), channels=3))
    files = write_views(views, lambda v, u: f"view_{v:02}_{u:02}.png")
    for field in (read(files, order=order), settle_order(LightField(views), Layout(order=order))):
        assert field.notes[-1].startswith(f"order: with order {order} the views seem to be {seen}, as ")
        assert field.notes[-1].endswith("; without it the pictures decide")
        assert field.is_ordered


@pytest.mark.parametrize("is_transposed", [False, True])
def test_the_note_names_the_option_for_columns_from_right_to_left(is_transposed):
    views = make_views((3, 5), channels=3)  # as cameras see it, columns from the left
    given = views[:, ::-1].swapaxes(0, 1) if is_transposed else views[:, ::-1]
    files = write_views(given, lambda v, u: f"view_{v:02}_{u:02}.png")
    field = read(files)
    assert field.depth_sense == "cameras"
    assert np.array_equal(field.views, views[::-1, ::-1])  # depth is inverted, which the note says
    options = field.notes[0].split("near and far are exchanged, give ")[1].split(";")[0]
    assert options == ("transpose and flip u" if is_transposed else "flip u")
    right = read(files, flip="u", transpose=is_transposed)
    assert right.depth_sense == "cameras"
    assert np.array_equal(right.views, views)


def test_no_view_is_decoded_to_check_the_order_given(monkeypatch):
    decoded = []
    decode = Decoder.decode
    monkeypatch.setattr(Decoder, "decode", lambda self, file: decoded.append(file) or decode(self, file))
    files = write_views(make_views((5, 5), channels=3), lambda v, u: f"{v}_{u}.png")
    content = inputs.open_input(Bundle("set", None, files), Layout(order="given"), views="0,0")
    assert content.is_ordered
    assert decoded == []  # none before it is used


def test_views_in_the_right_order_or_in_none_that_shows_are_left_as_they_are():
    for views in (make_views(), make_views(disparities=(0, 0))[::-1]):
        field = read(write_views(views, lambda v, u: f"{v}_{u}.png"))
        assert [note.split(":")[0] for note in field.notes] == ["views"]
        assert field.is_ordered
        assert np.array_equal(field.views, views)


def test_exchanged_views_are_noted_and_stay_where_they_are():
    views = make_views()
    views[2, [1, 3]] = views[2, [3, 1]]
    field = read(write_views(views, lambda v, u: f"{v}_{u}.png"))
    assert np.array_equal(field.views, views)
    assert "some seem to be exchanged, and all are left as they are" in field.notes[1]


def test_an_order_that_is_likely_is_noted(monkeypatch):
    monkeypatch.setattr(estimate, "CERTAIN_VOTES", 1000)
    views = make_views()[::-1]
    field = read(write_views(views, lambda v, u: f"{v}_{u}.png"))
    assert np.array_equal(field.views, views)
    assert field.notes[1].startswith("order: the views may be reversed along one axis, as ")
    assert ": flip v, or flip u with depth inverted, would put them right, " in field.notes[1]


@pytest.mark.parametrize("order", ORDERS[1:])
def test_the_note_on_an_elemental_image_array_names_the_options_that_put_it_right(order):
    views = make_views(channels=3)
    files = {"a.png": encode_png(LightField(put_in(order, views)).eia())}
    given = read(files, "a.png", pixels=(5, 5))
    assert np.array_equal(given.views, put_in(order, views))
    assert not given.is_ordered
    (note,) = given.notes
    assert note.startswith(f"order: the views seem to be {order}, as ")
    options = note.split(" as they are: ")[1].split(" would put them right")[0].split(", or ")[0].split(" and ")
    layout = {"transpose": "transpose" in options, "flip": "v" if "flip v" in options else "none"}
    right = read(files, "a.png", pixels=(5, 5), **layout)
    assert np.array_equal(right.views, views)
    assert (right.notes, right.is_ordered) == ((), True)
    assert (read(files, "a.png", pixels=(5, 5), order="given").notes) == ()


@pytest.mark.parametrize("is_transposed", [False, True])
@pytest.mark.parametrize("flip", ["none", "u", "v", "uv"])
@pytest.mark.parametrize("order", ORDERS[1:])
def test_the_options_of_a_note_replace_those_given(is_transposed, flip, order):
    views = make_views(disparities=(2, 2), side=64)
    given = LightField(put_in(order, views)).flip(flip)
    given = given.transpose() if is_transposed else given
    # transposing and then flipping `given` gives the views in `order`, and the note what to give instead
    (note,) = settle_order(given, Layout(flip=flip, transpose=is_transposed), corrects=False).notes
    options = note.split(" as they are: ")[1].split(" would put them right")[0].split(", or ")[0].split(" and ")
    flips = [option.removeprefix("flip ") for option in options if option.startswith("flip")]
    right = settle_order(given, Layout(flip=(flips or ["none"])[0], transpose="transpose" in options), corrects=False)
    assert np.array_equal(right.views, views)


@pytest.mark.parametrize(
    ("layout", "expected"),
    [
        ({"flip": "u"}, lambda views: views[:, ::-1]),
        ({"flip": "v"}, lambda views: views[::-1]),
        ({"flip": "uv"}, lambda views: views[::-1, ::-1]),
        ({"transpose": True}, lambda views: views.swapaxes(0, 1)),
        ({"transpose": True, "flip": "v"}, lambda views: views.swapaxes(0, 1)[::-1]),
        ({"order": "columns"}, lambda views: views.swapaxes(0, 1)),
        ({"order": "rows"}, lambda views: views),
    ],
)
def test_any_light_field_is_put_in_the_order_that_was_asked_for(layout, expected):
    random = np.random.default_rng(0)
    views = random.integers(0, 256, (2, 3, 4, 5, 3), np.uint8)
    files = write_views(views, lambda v, u: f"{v}_{u}.png")
    eia = {"a.png": encode_png(LightField(views).eia())}
    for field, sense in ((read(files, **layout), "cameras"), (read(eia, "a.png", pixels=(2, 3), **layout), "lenses")):
        assert np.array_equal(field.views, expected(views))
        assert field.depth_sense == sense  # the file counted the other way: what it counts stays


def test_names_without_rows_and_columns_fill_the_grid_that_the_pictures_show():
    views = make_views((3, 5))
    named = {f"{5 * v + u}.png": encode_png(views[v, u]) for v, u in np.ndindex(3, 5)}
    for pixels in (None, (3, 5), (5, 3)):  # the last one counts columns first
        field = read(named, pixels=pixels)
        assert np.array_equal(field.views, views)
        assert field.notes[0].startswith("views: 3x5, rows x columns: the names fill rows, 4.png ends the first")
    down = {f"{3 * u + v}.png": encode_png(views[v, u]) for v, u in np.ndindex(3, 5)}
    field = read(down, pixels=(3, 5))
    assert np.array_equal(field.views, views)
    assert "the names fill columns, 2.png ends the first" in field.notes[0]
    assert np.array_equal(read(down, pixels=(3, 5), order="columns").views, views)


@pytest.mark.parametrize("left", [slice(0, 24), slice(1, 25)])
def test_a_square_that_lacks_views_is_not_read_as_another_grid(left):
    flat = make_views((5, 5)).reshape(25, *make_views((5, 5)).shape[2:])[left]
    files = {f"{100 + number}.png": encode_png(picture) for number, picture in enumerate(flat)}
    with pytest.raises(InvalidOption, match="in order as 5x5 views, of which 1 is missing"):
        read(files)


def test_among_several_grids_most_tiles_decide():
    views = make_views((4, 6))  # one less than 5x5, and as many as in 3x8
    flat = views.reshape(24, *views.shape[2:])
    files = {f"{100 + number}.png": encode_png(picture) for number, picture in enumerate(flat)}
    assert np.array_equal(read(files).views, views)


def test_the_grid_with_the_most_votes_is_taken_even_if_another_is_certain(monkeypatch):
    flat = make_views((3, 8)).reshape(24, *make_views((3, 8)).shape[2:])
    votes = {(4, 6): 5, (3, 8): 20}

    def vote(views):
        count = votes.get(views.files.shape, 0)
        return estimate.OrderEstimate("as given", count, count)

    monkeypatch.setattr(reader, "estimate_order", vote)
    files = {f"{100 + number}.png": encode_png(picture) for number, picture in enumerate(flat)}
    assert read(files).shape[:2] == (3, 8)


def test_a_shape_that_the_pictures_do_not_have_is_noted():
    views = make_views((3, 5))
    files = write_views(views, lambda v, u: f"frame{5 * v + u:02}.png")
    field = read(files, pixels=(5, 3))
    assert np.array_equal(field.views, views)
    note = "pixels: 5x3 was asked for, but the pictures are in order as 3x5; order given keeps 5x3"
    assert note in field.notes
    assert read(files, pixels=(5, 3), order="given").shape[:2] == (5, 3)
    assert not [note for note in read(files, pixels=(3, 5)).notes if note.startswith("pixels: ")]


@pytest.mark.parametrize("is_transposed", [False, True])
@pytest.mark.parametrize("shape", [(5, 5), (4, 6)])
def test_views_of_a_gantry_that_moves_to_and_fro_are_put_right(shape, is_transposed):
    views = make_views(shape, channels=3)
    taken = wind(views.swapaxes(0, 1) if is_transposed else views).reshape(-1, *views.shape[2:])
    files = {f"IMG_{1000 + number}.png": encode_png(picture) for number, picture in enumerate(taken)}
    field = read(files)
    assert np.array_equal(field.views, views)
    (note,) = field.notes
    line = "columns" if is_transposed else "rows"
    last = 999 + (shape[0] if is_transposed else shape[1])
    assert f"the names fill {line}, IMG_{last}.png ends the first, every other line of them reversed, which " in note
    assert "; order given keeps the order of the names" in note
    asked = read(files, pixels=shape[::-1] if is_transposed else shape, order="serpentine")
    assert np.array_equal(asked.views, views.swapaxes(0, 1) if is_transposed else views)
    note, *others = asked.notes
    assert ["seem to be transposed" in other for other in others] == ([True] if is_transposed else [])
    assert note.startswith("views: ")
    assert note.endswith("every other line of them reversed; transpose takes them the other way")
    across = read(files, pixels=shape[::-1] if is_transposed else shape, order="serpentine", transpose=True)
    assert np.array_equal(across.views, asked.views.swapaxes(0, 1))
    assert across.notes[0].endswith("; no transpose takes them the other way")


def test_the_note_on_a_gantry_that_starts_at_the_right_names_the_options():
    views = make_views(channels=3)
    files = write_views(wind(views[:, ::-1]), lambda v, u: f"{5 * v + u}.png")
    options = read(files).notes[0].split("near and far are exchanged, give ")[1].split(";")[0]
    assert options == "order serpentine and flip u"
    assert np.array_equal(read(files, order="serpentine", flip="u").views, views)


@pytest.mark.parametrize(
    ("taken", "flip", "options"),
    [
        (lambda views: wind(views[::-1]), "v", "order serpentine and flip v"),
        (lambda views: wind(views[:, ::-1]), "u", "order serpentine and flip u"),
        (wind, "uv", "order serpentine and flip uv"),
        (
            wind,
            "v",
            "order serpentine and no flip and no transpose, or order serpentine and flip uv with depth inverted,",
        ),
    ],
)
def test_a_flip_that_fits_is_kept_where_every_other_row_is_still_reversed(taken, flip, options):
    views = make_views(channels=3)
    files = write_views(taken(views), lambda v, u: f"{5 * v + u}.png")
    note = read(files, flip=flip).notes[-1]
    also = " and reversed along one axis" if " or " in options else ""
    assert f"the views seem to be reversed in every other row{also}, as " in note
    assert f"are left as they are: {options} would put them right, order given keeps" in note


@pytest.mark.parametrize("order", ORDERS)
def test_arrays_with_every_other_row_reversed_are_put_right_or_noted(order):
    views = make_views(channels=3)
    given = LightField(wind(put_in(order, views)))
    right = settle_order(given, Layout())
    assert np.array_equal(right.views, views)
    assert "every other line of views reversed, which fits " in right.notes[0]
    noted = settle_order(given, Layout(), corrects=False)
    assert np.array_equal(noted.views, given.views)
    options = noted.notes[0].split(" as they are: ")[1].split(" would put")[0].split(", or ")[0].split(" and ")
    layout = Layout(order="serpentine", flip="v" if "flip v" in options else "none", transpose="transpose" in options)
    assert options[0] == "order serpentine"
    assert np.array_equal(settle_order(given, layout).views, views)
