"""Draws the contact sheet: one view of each scene in four ways, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.readers.pictures import Pixels

ZOOM = 2
"""Each pixel of a finished picture is shown as `ZOOM x ZOOM`."""
MARGIN, HEAD, LABEL, TEXT = 16, 52, 34, 22
"""Pixels: between pictures, above the columns, below each picture; and the size of the text."""
PAPER, INK, FAINT = (250, 250, 248), (24, 24, 28), (110, 110, 118)
BORDER = 2
"""Pixels cut on each side before a picture is compared with the truth, as the published protocol does at x2."""


@dataclass(frozen=True)
class Row:
    """A scene's view, `(H, W, 3)` 8 bit: as mapped, at half the size; and made large in three ways."""

    scene: str
    mapped: Pixels
    bicubic: Pixels
    network: Pixels
    truth: Pixels


def draw(rows: Sequence[Row], *, network: str) -> Pixels:
    """The sheet, `(H, W, 3)`: a row for each scene; below each picture its Y-PSNR against the one rendered directly."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = rows[0].truth.shape[:2]
    cell_w, cell_h = width * ZOOM + MARGIN, height * ZOOM + LABEL + MARGIN
    sheet = Image.new("RGB", (4 * cell_w + MARGIN, HEAD + len(rows) * cell_h), PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(TEXT)
    heads = (
        f"mapped (lenslet), {width // 2}x{height // 2}",
        f"bicubic, {width}x{height}",
        f"network '{network}', {width}x{height}",
        f"rendered directly, {width}x{height}",
    )
    for column, head in enumerate(heads):
        pen.text((MARGIN + column * cell_w, MARGIN), head, INK, font)
    for number, row in enumerate(rows):
        top = HEAD + number * cell_h
        for column, picture in enumerate((row.mapped, row.bicubic, row.network, row.truth)):
            left = MARGIN + column * cell_w
            large = picture.repeat(height * ZOOM // len(picture), 0).repeat(width * ZOOM // picture.shape[1], 1)
            sheet.paste(Image.fromarray(large.astype(np.uint8)), (left, top))
            pen.text((left, top + height * ZOOM + 4), _caption(row, column), FAINT, font)
    return np.asarray(sheet)


def _caption(row: Row, column: int) -> str:
    if column == 0:
        return f"{row.scene}, the centre view"
    if column == 3:
        return "the truth that PSNR refers to"
    picture = row.bicubic if column == 1 else row.network
    return f"PSNR {_compute_luma_psnr(picture, row.truth):.2f} dB"


def _compute_luma_psnr(picture: Pixels, truth: Pixels) -> float:
    """Y-PSNR in dB as `training.evaluation.metrics` computes it, which needs packages that the core has not."""
    inside = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    error = (picture[inside].astype(float) - truth[inside]) @ np.array([65.481, 128.553, 24.966]) / 255
    return float(20 * np.log10(255) - 10 * np.log10(np.mean(error**2)))
