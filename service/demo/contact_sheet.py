"""Draws the contact sheet: for each scene, the centre view in five ways side by side, and all its views in a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.service.demo.scores import Score, compare

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont, ImageFont

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View

ZOOM = 2
"""Each pixel of a finished picture is shown as `ZOOM x ZOOM`."""
MARGIN, TEXT, LINE = 20, 28, 38
"""Pixels between pictures, size of the text, and pixels from one line of text to the next."""
HEAD, TITLE = 2 * MARGIN + 2 * LINE, LINE + 12
"""Pixels above the rows, and above the pictures of a row."""
CAPTION = LINE + 6
"""Pixels for the text below a picture."""
GAP = 0.05
"""Gap between the views of the grid, relative to their width."""
PAPER, INK, FAINT, LINES = (250, 250, 248), (24, 24, 28), (96, 96, 104), (84, 84, 90)
"""Colours. `LINES` is the colour between the views of the grid."""


@dataclass(frozen=True)
class Row:
    """The pictures made from a scene, `(H, W, 3)`, 8 bit."""

    scene: str
    mapped: Pixels
    """The centre view as mapped, at half the size."""
    bicubic: Pixels
    single: Pixels
    """The centre view upscaled by the default single-picture network."""
    views: Mapping[View, Pixels]
    """All views of the elemental image array, upscaled by the model that `auto` takes."""
    truth: Mapping[View, Pixels]
    """The corner view (0, 0) and the centre view, rendered at the larger size."""
    single_model: str
    """Names of models: the single-picture network, and the model that `auto` took."""
    default_model: str

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of views."""
        last = max(self.views)
        return last[0] + 1, last[1] + 1

    @property
    def centre(self) -> View:
        """The view that is shown large."""
        return self.grid[0] // 2, self.grid[1] // 2

    def list_pictures(self) -> list[Pixels]:
        """Lists the centre view in each way, as large as the truth: mapped, bicubic, single, default, truth."""
        large = self.mapped.repeat(2, 0).repeat(2, 1)
        return [large, self.bicubic, self.single, self.views[self.centre], self.truth[self.centre]]

    def score_all(self) -> list[Score]:
        """Scores all of `list_pictures` except the last, which is the truth."""
        *made, truth = self.list_pictures()
        return [compare(picture, truth) for picture in made]


def draw(rows: Sequence[Row]) -> Pixels:
    """Draws the sheet, `(H, W, 3)`: a row for each scene, with Y-PSNR and SSIM against the truth below each picture."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = rows[0].bicubic.shape[:2]
    shown = width * ZOOM, height * ZOOM
    cell_w, cell_h = shown[0] + MARGIN, TITLE + shown[1] + CAPTION + MARGIN
    heads = _list_heads(rows)
    sheet = Image.new("RGB", (len(heads) * cell_w + MARGIN, HEAD + len(rows) * cell_h), PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(TEXT)

    def write(left: int, top: int, text: str, colour: tuple[int, int, int]) -> None:
        pen.text((left, top), text, colour, _fit(font, text, shown[0]))

    for column, lines in enumerate(heads):
        for line, text in enumerate(lines):
            write(MARGIN + column * cell_w, MARGIN + line * LINE, text, FAINT if line else INK)
    for number, row in enumerate(rows):
        top = HEAD + number * cell_h
        write(MARGIN, top + 6, row.scene, INK)
        pictures = [Image.fromarray(picture).resize(shown, Image.Resampling.NEAREST) for picture in row.list_pictures()]
        for column, picture in enumerate([*pictures, _draw_grid(row, shown)]):
            sheet.paste(picture, (MARGIN + column * cell_w, top + TITLE))
        for column, text in enumerate(_list_captions(row)):
            write(MARGIN + column * cell_w, top + TITLE + shown[1] + 4, text, FAINT)
    return np.asarray(sheet)


def _list_heads(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Lists the two lines above each column."""
    row = rows[0]
    height, width = row.bicubic.shape[:2]
    single = " or ".join(dict.fromkeys(row.single_model for row in rows))
    default = " or ".join(dict.fromkeys(row.default_model for row in rows))
    return [
        ("nearest", f"view as mapped, {width // 2}x{height // 2}"),
        ("bicubic", f"interpolation, {width}x{height}"),
        (single, "from this view alone"),
        (f"default: {default}", "with neighbouring views"),
        ("truth", f"rendered at {width}x{height}"),
        ("the whole array by the default", "{}x{} views of {}x{}".format(*row.grid, width, height)),
    ]


def _list_captions(row: Row) -> list[str]:
    """Lists the text below each picture."""
    corner = compare(row.views[0, 0], row.truth[0, 0])
    return [*map(str, row.score_all()), "the centre view", f"corner: {corner}"]


def _draw_grid(row: Row, size: tuple[int, int]) -> Image:
    """Draws all views in their order, reduced to `size`, width and height."""
    from PIL import Image

    height, width = row.bicubic.shape[:2]
    gap = max(1, round(GAP * width))
    rows, cols = row.grid
    grid = Image.new("RGB", (cols * (width + gap) - gap, rows * (height + gap) - gap), LINES)
    for (v, u), picture in row.views.items():
        grid.paste(Image.fromarray(picture), (u * (width + gap), v * (height + gap)))
    return grid.resize(size, Image.Resampling.BOX)


def _fit(font: FreeTypeFont | ImageFont, text: str, width: int) -> FreeTypeFont | ImageFont:
    """Returns `font`, or a smaller one if `text` would be wider than `width` pixels."""
    from PIL import ImageFont

    length = font.getlength(text)
    return font if length <= width else ImageFont.load_default(max(1, int(TEXT * width / length)))
