"""Folders of training pictures as 8-bit RGB, only some of which are kept in memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ciir.bit_depth import count_unused_bits, raise_levels
from ciir.renderer.limits import DEFAULT_LIMITS
from ciir.renderer.readers.bundle import read_file
from ciir.renderer.readers.pictures import SUFFIXES, decode

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

Picture = NDArray[np.uint8]
"""`(H, W, C)`, 8 bit."""
MEMORY = 4 * 2**30
"""Most bytes of decoded pictures that are kept. Other pictures are decoded on each access."""
VOC = ("JPEGImages", "VOC2012/JPEGImages", "VOCdevkit/VOC2012/JPEGImages")
"""Places of VOC2012's pictures within its folder, and within the folders above it in the unpacked archive."""


def find_pictures(folder: Path) -> list[Path]:
    """Lists the pictures in `folder`, or in VOC2012 if `folder` is or contains it, sorted by name.

    Other files, hidden ones and folders are ignored. Raises `ValueError` if there is no folder, or no picture in it.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; name a folder of pictures")
    place = next((folder / voc for voc in VOC if (folder / voc).is_dir()), folder)
    files = sorted(
        path
        for path in place.iterdir()
        if path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()
    )
    if not files:
        raise ValueError(f"{place}: no picture in it ({', '.join(sorted(SUFFIXES))}); name a folder with pictures")
    return files


def pair_files(files: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Lists each `*_LR.png` of `files` with its `*_HR.png`. Raises `ValueError` if one of these is missing."""
    lows = [path for path in files if path.name.endswith("_LR.png")]
    pairs = [(low, low.with_name(low.name.replace("_LR.png", "_HR.png"))) for low in lows]
    for _, high in pairs:
        if not high.is_file():
            raise ValueError(f"{high}: missing; each *_LR.png needs its *_HR.png")
    return pairs


def read_picture(path: Path, *, unused: int = 0) -> Picture:
    """Reads a picture as 8-bit `(H, W, 1)` grey or `(H, W, 3)` RGB, rotated by its orientation tag.

    16 bits are rounded to 8, palettes become RGB, and transparent pixels are blended with black. `unused`: how many of
    the upper bits of 16 no picture of the set uses, as returned by `count_unused`.

    Raises `ValueError` if it can't be read, because it is truncated, not a picture, or CMYK.
    """
    return _convert(_decode(path), unused)


def _convert(pixels: NDArray[np.uint8] | NDArray[np.uint16], unused: int) -> Picture:
    if pixels.dtype == np.uint8 and pixels.shape[2] in (1, 3):
        return pixels.astype(np.uint8)
    if pixels.dtype == np.uint16:
        pixels = raise_levels(pixels, unused)
    values = pixels / np.iinfo(pixels.dtype).max
    if pixels.shape[2] in (2, 4):
        values = values[..., :-1] * values[..., -1:]
    return np.floor(values * 255 + 0.5).astype(np.uint8)


def count_unused(files: Iterable[Path]) -> int:
    """Counts the upper bits of 16 that none of these pictures uses, as with a camera of 10 or 12 bits
    (`ciir.bit_depth`). 8-bit pictures don't count. Raises `ValueError` as `read_picture` does.
    """
    unused: int | None = None
    for file in files:
        pixels = _decode(file)
        if pixels.dtype == np.uint16:
            bits = count_unused_bits(pixels)
            unused = bits if unused is None else min(unused, bits)
        if unused == 0:
            break
    return unused or 0


def _decode(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    return decode(read_file(path, DEFAULT_LIMITS), name=str(path))


def read_rgb(path: Path, *, unused: int = 0) -> Picture:
    """Reads a picture like `read_picture`, with grey as three equal channels: `(H, W, 3)`."""
    return _repeat_grey(read_picture(path, unused=unused))


def _repeat_grey(pixels: Picture) -> Picture:
    return pixels if pixels.shape[2] == 3 else np.repeat(pixels, 3, axis=2)


def convert_to_input(picture: Picture) -> NDArray[np.float32]:
    """Converts `(H, W, C)` 8 bit to the input of a network: `(1, C, H, W)` float32 in [0, 1]."""
    return np.ascontiguousarray(picture.transpose(2, 0, 1)[np.newaxis].astype(np.float32) / 255)


class Pictures:
    """A folder's pictures as 8-bit RGB `(H, W, 3)`, in the order of their names.

    Each is decoded once at the start, to find errors early and to find how many bits the 16-bit ones use
    (`count_unused`). The first ones are kept, up to `memory` bytes.
    """

    def __init__(self, folder: Path, *, memory: int = MEMORY) -> None:
        """Raises `ValueError` as `find_pictures` and `read_picture` do."""
        self.files = find_pictures(folder)
        self.sizes: list[tuple[int, int]] = []
        """Height and width of each picture."""
        self._kept: list[Picture] = []
        left, unused = memory, []
        for path in tqdm(self.files, disable=None, desc="reading", unit="picture", leave=False):
            pixels = _decode(path)
            if pixels.dtype == np.uint16:
                unused.append(count_unused_bits(pixels))
            picture = _repeat_grey(_convert(pixels, 0))
            self.sizes.append((picture.shape[0], picture.shape[1]))
            left -= picture.nbytes
            if left >= 0:
                self._kept.append(picture)
        self._unused = min(unused, default=0)
        if self._unused:  # this is known only after all of them are decoded
            self._kept = [read_rgb(path, unused=self._unused) for path in self.files[: len(self._kept)]]

    def __getstate__(self) -> dict[str, Any]:
        """Leaves out the pictures that are kept, because another process reads those that it needs."""
        return self.__dict__ | {"_kept": []}

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, index: int) -> Picture:
        """Raises `ValueError` if the file has changed since the start."""
        if index < len(self._kept):
            return self._kept[index]
        picture = read_rgb(self.files[index], unused=self._unused)
        if picture.shape[:2] != self.sizes[index]:
            raise ValueError(f"{self.files[index]}: was changed during the run; start again")
        return picture
