import numpy as np
import pytest
from PIL import ImageFont

from ciir.service.demo import contact_sheet
from ciir.service.demo.contact_sheet import CAPTION, HEAD, MARGIN, PAPER, TEXT, TITLE, ZOOM
from tests.support.inputs import make_picture


def make_row(lenses, *, grid=(3, 3), default="field"):
    size = 2 * lenses
    mapped, bicubic, single = (
        make_picture(side, side, seed=seed) for seed, side in ((0, lenses), (1, size), (2, size))
    )
    views = {
        (v, u): np.full((size, size, 3), (40 * v, 40 * u, 90), np.uint8) for v in range(grid[0]) for u in range(grid[1])
    }
    centre = grid[0] // 2, grid[1] // 2
    views[centre] = make_picture(size, size, seed=3)
    truth = {(0, 0): make_picture(size, size, seed=4), centre: make_picture(size, size, seed=5)}
    return contact_sheet.Row("noise", mapped, bicubic, single, views, truth, "fast", default)


def test_it_shows_the_pictures_themselves():
    row = make_row(20)
    sheet = contact_sheet.draw([row])
    top, side = HEAD + TITLE, 40 * ZOOM
    pictures = (row.mapped, row.bicubic, row.single, row.views[1, 1], row.truth[1, 1])
    for column, picture in enumerate(pictures):
        step = side // len(picture)
        left = MARGIN + column * (side + MARGIN)
        shown = sheet[top : top + side, left : left + side]
        assert np.array_equal(shown[::step, ::step], picture)
        assert np.array_equal(shown[step - 1 :: step, step - 1 :: step], picture)


def test_it_shows_every_view_in_its_place():
    row = make_row(20)
    sheet = contact_sheet.draw([row])
    top, left, side = HEAD + TITLE, MARGIN + 5 * (40 * ZOOM + MARGIN), 40 * ZOOM
    for (v, u), picture in row.views.items():
        if (v, u) != (1, 1):
            middle = sheet[top + side * (2 * v + 1) // 6, left + side * (2 * u + 1) // 6]
            assert np.array_equal(middle, picture[0, 0])


@pytest.mark.parametrize("default", ["field", "field-quality-int8 or quality-int8"])
def test_no_text_leaves_its_column_or_meets_a_picture(default):
    rows = [make_row(100, default=default)] * 2
    sheet = contact_sheet.draw(rows)
    empty = np.all(sheet == PAPER, axis=2)
    side = 200 * ZOOM
    for column in range(7):  # the space between columns
        assert empty[:, column * (side + MARGIN) : column * (side + MARGIN) + MARGIN].all()
    height = TITLE + side + CAPTION + MARGIN
    for number in range(len(rows)):
        picture = HEAD + number * height + TITLE
        assert empty[picture - 2 : picture].all()
        assert empty[picture + side : picture + side + 2].all()
        assert empty[picture + side + CAPTION : picture + side + CAPTION + MARGIN].all()
    assert empty[:MARGIN].all()


def test_text_of_shipped_models_is_in_one_size():
    font = ImageFont.load_default(TEXT)
    rows = [make_row(100, grid=(9, 9), default="field-quality-int8")]
    texts = [text for lines in contact_sheet._list_heads(rows) for text in lines]
    assert all(font.getlength(text) <= 200 * ZOOM for text in [*texts, "corner: 48.88 dB, SSIM 0.888"])


def test_models_that_differ_by_scene_are_all_named():
    heads = contact_sheet._list_heads([make_row(20), make_row(20, default="fast"), make_row(20)])
    assert heads[3][0] == "default: field or fast"
