"""Writes a light field for a viewer that reads it while it arrives: a zip of a few JPEGs, the coarse one first."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from ciir.bit_depth import count_unused_camera_bits
from ciir.errors import InvalidOption
from ciir.renderer.levels import note_rounding, round_to_8_bit
from ciir.renderer.readers.names import TILES
from ciir.renderer.writers.pictures.jpeg import MAX_SIDE, encode
from ciir.renderer.writers.whole import WholeWriter
from ciir.renderer.writers.writer import ZIP_DATE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.light_field import LightField
    from ciir.renderer.writers.writer import Contents

COARSE = 4
"""How many times smaller each side of the views in the first mosaic is."""
BLOCK = 8
"""Pixels along a side of the blocks that JPEG transforms: with cells of whole blocks, no view's edge shows in the
next."""
QUALITY = 90
DESCRIPTION, COARSE_TILE = TILES


@dataclass(frozen=True)
class Tile:
    """A mosaic: view (v, u) of `rows` rows of views from `row` on begins at pixel ((v - row) * cell_height, u *
    cell_width) and has `height x width` pixels. The rest of its cell repeats its last row and column.
    """

    file: str
    row: int
    rows: int
    height: int
    width: int
    cell_height: int
    cell_width: int


def plan_tiles(rows: int, height: int, width: int) -> list[Tile]:
    """Returns one mosaic of all views at a quarter of their size, then one for each of the `rows` rows of views of
    `height x width` pixels, starting with those around the middle.
    """
    small_height, small_width = -(-height // COARSE), -(-width // COARSE)
    coarse = Tile(COARSE_TILE, 0, rows, small_height, small_width, _fill(small_height), _fill(small_width))
    order = sorted(range(rows), key=lambda row: abs(row - (rows - 1) / 2))
    cell = _fill(height), _fill(width)
    return [coarse, *(Tile(f"row_{row:02d}.jpg", row, 1, height, width, *cell) for row in order)]


class TilesWriter(WholeWriter):
    """Writes `light_field.json`, which describes the tiles, and each of them, in that order and uncompressed."""

    def check(self, contents: Contents) -> None:
        """Refuses mosaics that JPEG can't hold."""
        rows, cols = contents.grid
        for tile in plan_tiles(rows, contents.height, contents.width):
            if max(tile.rows * tile.cell_height, cols * tile.cell_width) > MAX_SIDE:
                raise InvalidOption(
                    f"format: {cols} views of {contents.width} pixels side by side; tiles hold {MAX_SIDE} pixels "
                    "along a side; give fewer or smaller views"
                )

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the zip, whose local headers contain the sizes, so that a reader needs no directory."""
        rows, cols, height, width, channels = light_field.views.shape
        unused = count_unused_camera_bits(light_field.views)
        tiles = plan_tiles(rows, height, width)
        assert self._contents is not None  # noqa: S101 - `begin` was called: the contract of Writer
        size = {"rows": rows, "cols": cols, "height": height, "width": width, "scale": self._contents.scale}
        described = {**size, "depth_sense": light_field.depth_sense, "tiles": [asdict(tile) for tile in tiles]}
        with zipfile.ZipFile(self.file, "w", zipfile.ZIP_STORED) as archive:
            archive.writestr(zipfile.ZipInfo(DESCRIPTION, ZIP_DATE), json.dumps(described))
            for tile in tiles:
                jpeg = encode(_draw(light_field, tile, unused), QUALITY)
                archive.writestr(zipfile.ZipInfo(tile.file, ZIP_DATE), jpeg)
        notes = [f"tiles are JPEG of quality {QUALITY}"]
        notes += ["tiles: alpha is left out"] * (channels in (2, 4))
        return notes + note_rounding(self.name, light_field.views.dtype, unused)


def _draw(light_field: LightField, tile: Tile, unused: int) -> NDArray[np.uint8]:
    """Draws the mosaic, `(H, W)` or `(H, W, 3)`; `unused`: from `count_unused_camera_bits` of all views."""
    views = light_field.views[tile.row : tile.row + tile.rows]
    rows, cols, _, _, channels = views.shape
    kept = 1 if channels < 3 else 3
    mosaic = np.empty((rows, tile.cell_height, cols, tile.cell_width, kept), np.uint8)
    for v, u in np.ndindex(rows, cols):
        pixels = round_to_8_bit(views[v, u, ..., :kept], unused)
        if pixels.shape[:2] != (tile.height, tile.width):
            picture = Image.fromarray(np.ascontiguousarray(pixels[..., 0] if kept == 1 else pixels))
            small = np.asarray(picture.resize((tile.width, tile.height), Image.Resampling.BOX))
            pixels = small.reshape(tile.height, tile.width, kept)
        below, right = tile.cell_height - tile.height, tile.cell_width - tile.width
        mosaic[v, :, u] = np.pad(pixels, ((0, below), (0, right), (0, 0)), "edge")
    drawn = mosaic.reshape(rows * tile.cell_height, cols * tile.cell_width, kept)
    return drawn[..., 0] if kept == 1 else drawn


def _fill(length: int) -> int:
    """Returns the next multiple of `BLOCK`."""
    return -(-length // BLOCK) * BLOCK
