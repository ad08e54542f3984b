"""Collects training pictures from any folders: shrinks photographs, flattens transparency and cuts tiles.

    python -m ciir.training.data.gather FOLDER... -o PICTURES [--at-most 250] [--exclude ../shared/data/images/Set5 ...]

docs/training.md lists the pictures that `fast` and `quality` were trained on.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import itertools
import struct
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, UnidentifiedImageError
from tqdm import tqdm

from ciir.training.data.pictures import find_pictures as find_files
from ciir.training.data.pictures import read_rgb

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

SIDE = 480
"""Largest side of a tile in pixels. With it, drawing tiles evenly means drawing by area."""
LEAST = 160
"""Smallest side of a picture in pixels. Smaller pictures can't hold a crop and are skipped."""
LOSSY, DRAWN = 2000, 800
"""The longer side in pixels to which lossy and lossless files are shrunk. Lossy ones are at least halved."""
FLAT = 1.5
"""Tiles with a lower mean difference between neighbouring pixels, in levels, are dropped."""
SAME = 0.97
"""Correlation of 16x16 thumbnails above which two pictures count as the same."""
Place = tuple[Path, int, int]
"""A file, and the first byte and the number of bytes of a picture in it."""
SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".tga")
PACKED = ".rcc"
"""Qt's resource files, which contain WebP pictures uncompressed."""


def find_pictures(folder: Path) -> Iterator[Place]:
    """Yields the file, first byte and number of bytes of each picture anywhere in `folder`, in the order of names."""
    for path in sorted(folder.rglob("*")):
        if path.is_symlink() or not path.is_file():
            continue
        if path.suffix.lower() in SUFFIXES:
            yield path, 0, path.stat().st_size
        elif path.suffix.lower() == PACKED:
            content, at = path.read_bytes(), -1
            while (at := content.find(b"RIFF", at + 1)) >= 0:
                if content[at + 8 : at + 12] == b"WEBP":
                    yield path, at, struct.unpack_from("<I", content, at + 4)[0] + 8


def load_picture(content: bytes) -> NDArray[np.uint8] | None:
    """Decodes and shrinks a picture to 8-bit RGB `(H, W, 3)`; None if it is not a picture or too small.

    Transparent pixels get a plain background colour that depends only on the content.
    """
    try:
        with Image.open(io.BytesIO(content)) as opened:
            lossy = opened.format in ("JPEG", "WEBP")
            picture = opened.convert("RGBA")
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    colour = tuple(hashlib.sha256(content).digest()[:3])
    below = Image.new("RGBA", picture.size, (*colour, 255))
    below.alpha_composite(picture)
    longer = max(picture.size)
    factor = max(2.0, longer / LOSSY) if lossy else max(1.0, longer / DRAWN)
    size = [round(length / factor) for length in picture.size]
    if min(size) < LEAST:
        return None
    return np.asarray(below.convert("RGB").resize((size[0], size[1]), Image.Resampling.LANCZOS))


def cut_tiles(picture: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Cuts a picture into equal tiles of at most `SIDE` pixels, without the flat ones."""
    rows, cols = (np.linspace(0, length, -(-length // SIDE) + 1).astype(int) for length in picture.shape[:2])
    cut = [picture[a:b, c:d] for a, b in itertools.pairwise(rows) for c, d in itertools.pairwise(cols)]
    return [tile for tile in cut if np.abs(np.diff(tile.mean(axis=2), axis=1)).mean() >= FLAT]


def make_thumbnail(picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Returns 16x16 grey levels as a vector of mean 0 and length 1, for comparing pictures."""
    small = Image.fromarray(picture).convert("L").resize((16, 16), Image.Resampling.BOX)
    levels = np.asarray(small, float).ravel()
    levels -= levels.mean()
    return levels / max(float(np.linalg.norm(levels)), 1e-9)


def _split(places: Sequence[Place], size: int) -> Iterator[Sequence[Place]]:
    """Splits `places` into parts of `size`, so that only as many as needed are read."""
    return (places[at : at + size] for at in range(0, len(places), size))


def _load(place: Place) -> tuple[NDArray[np.uint8], NDArray[np.float64]] | None:
    path, first, length = place
    with path.open("rb") as file:
        file.seek(first)
        picture = load_picture(file.read(length))
    return None if picture is None else (picture, make_thumbnail(picture))


def gather_pictures(folders: Sequence[Path], out: Path, *, at_most: int, exclude: Sequence[Path] = ()) -> int:
    """Writes tiles of up to `at_most` different pictures of each folder as PNG into `out`. Returns the number of tiles.

    `exclude`: folders of test pictures. Pictures that look like one of them are skipped. The selection depends only on
    the files' contents and paths. Raises `ValueError` if a folder holds no picture, two folders have the same name, or
    `at_most` is less than 1.
    """
    if at_most < 1:
        raise ValueError(f"at_most is {at_most}; give 1 or more")
    Image.MAX_IMAGE_PIXELS = 2**29
    out.mkdir(parents=True, exist_ok=True)
    tested = [path for folder in exclude for path in find_files(folder) if not path.name.endswith("_LR.png")]
    known = [make_thumbnail(read_rgb(path)) for path in tested]
    if len({folder.resolve().name for folder in folders}) < len(folders):
        raise ValueError("two folders have the same name, which tiles are named after; rename one")
    written = 0
    for folder in folders:
        places = list(find_pictures(folder))
        np.random.default_rng(0).shuffle(places)
        taken = alike = 0
        with ProcessPoolExecutor() as pool:
            loading = (loaded for part in _split(places, 64) for loaded in pool.map(_load, part, chunksize=8))
            for picture, small in tqdm(filter(None, loading), disable=None, desc=folder.name, unit="picture"):
                if known and float((np.stack(known) @ small).max()) > SAME:
                    alike += 1
                    continue
                known.append(small)
                kept = cut_tiles(picture)
                taken += bool(kept)
                for number, tile in enumerate(kept):
                    Image.fromarray(tile).save(out / f"{folder.name}-{taken:04}-{number:02}.png", compress_level=1)
                written += len(kept)
                if taken == at_most:
                    break
        print(f"{folder}: {taken} pictures taken, {alike} skipped as similar to others")
    if not written:
        raise ValueError(f"{', '.join(map(str, folders))}: no picture of {LEAST} pixels or more; name other folders")
    print(f"{out}: {written} tiles of different pictures, none similar to {len(tested)} test pictures")
    return written


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the tiles")
    parser.add_argument("--at-most", type=int, default=250, help="pictures of each folder (default: %(default)s)")
    parser.add_argument("--exclude", type=Path, nargs="*", default=(), help="folders of test pictures to exclude")
    given = parser.parse_args(arguments)
    for folder in (*given.folders, *given.exclude):
        if not folder.is_dir():
            parser.error(f"{folder}: no such folder; name one that holds pictures")
    try:
        gather_pictures(given.folders, given.out, at_most=given.at_most, exclude=given.exclude)
    except ValueError as error:
        sys.exit(f"gather: {error}")


if __name__ == "__main__":
    main()
