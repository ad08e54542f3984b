"""Labels pictures with a stronger network: its upscaling of each picture's low-resolution version becomes the truth.

    python -m ciir.training.data.labels PICTURES --network plainusr-l-x2.onnx -o LABELLED

A small network learns more from a large one's output for the same LR than from the true picture (distillation, Hinton
et al. 2015). The folder is for a recipe's `labelled`.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image
from tqdm import tqdm

from ciir.cores import count_available_cores
from ciir.models.sessions import open_session
from ciir.training.data.downscale import Pair, downscale_picture
from ciir.training.data.pictures import convert_to_input, count_unused, find_pictures, read_rgb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from onnxruntime import InferenceSession

    from ciir.training.data.pictures import Picture

SCALE = 2
LEAST = 16
"""Smallest side, in pixels, of LR that is labelled."""
LOW, HIGH = "_LR.png", "_HR.png"
"""Suffixes of a pair's files."""


def label_pictures(
    folder: Path, network: Path, out: Path, *, scales: Sequence[float] = (1.0,), threads: int | None = None
) -> int:
    """Writes `NAME_LR.png`, bicubic at half size, and `NAME_HR.png`, the output of `network` for it. Returns the number
    of pairs.

    `network`: an ONNX file that takes RGB `(1, 3, H, W)` in [0, 1] and returns `(1, 3, 2*H, 2*W)`. `scales`: sizes of
    the pictures, up to 1. Each makes a pair, and `NAME` becomes, for example, `NAME-50` at half the size. `threads`:
    how many pairs are made at once, each on one core. Pairs that are already in `out` are kept. Pictures smaller than
    `LEAST` at half size are skipped.

    Raises `ValueError` as `find_pictures` does, if two pictures differ only in the suffix, and if the network's output
    has another size.
    """
    files = find_pictures(folder)
    stems = [file.stem for file in files]
    if len(set(stems)) < len(stems):
        twice = next(stem for stem in stems if stems.count(stem) > 1)
        raise ValueError(f"{folder}: two pictures are named {twice}; pairs are named without the suffix: rename one")
    session = open_session(network.read_bytes(), threads=1)
    out.mkdir(parents=True, exist_ok=True)
    unused = count_unused(files)

    def label(file: Path) -> int:
        picture = read_rgb(file, unused=unused)
        return sum(_write_pair(session, network, picture, scale, out / file.stem) for scale in scales)

    pool = ThreadPoolExecutor(threads or count_available_cores())
    try:
        return sum(tqdm(pool.map(label, files), total=len(files), disable=None, desc="labelling", unit="picture"))
    finally:
        pool.shutdown(cancel_futures=True)


def _write_pair(session: InferenceSession, network: Path, picture: Picture, scale: float, stem: Path) -> bool:
    """Writes the pair of a picture at one scale. Returns whether there was one to write."""
    name = stem.name if scale == 1 else f"{stem.name}-{100 * scale:.0f}"
    low_path, high_path = (stem.with_name(f"{name}{suffix}") for suffix in (LOW, HIGH))
    size = [round(scale * side) for side in picture.shape[:2]]
    if min(size) < LEAST * SCALE or high_path.exists():
        return False
    if scale != 1:
        picture = np.asarray(Image.fromarray(picture).resize(size[::-1], Image.Resampling.LANCZOS))
    low = downscale_picture("bicubic", picture, SCALE).low
    planes = convert_to_input(low)
    made = session.run(None, {session.get_inputs()[0].name: planes})[0]
    if made.shape != (1, 3, SCALE * low.shape[0], SCALE * low.shape[1]):
        raise ValueError(f"{network}: makes {made.shape} from {planes.shape}; name a network that upscales by {SCALE}")
    high = np.floor(np.clip(made[0].transpose(1, 2, 0), 0, 1) * 255 + 0.5).astype(np.uint8)
    Image.fromarray(low).save(low_path, compress_level=1)
    Image.fromarray(high).save(high_path, compress_level=1)  # last: its presence shows that the pair is complete
    return True


def read_labelled(folder: Path) -> list[Pair]:
    """Reads the pairs `(h, w, 3)` and `(2*h, 2*w, 3)` that `label_pictures` wrote. Raises `ValueError` for others."""
    highs = [file for file in find_pictures(folder) if file.name.endswith(HIGH)]
    if not highs:
        raise ValueError(f"{folder}: no pair of *{LOW} and *{HIGH} in it; make some with training.data.labels")
    with ThreadPoolExecutor(count_available_cores()) as pool:
        read = pool.map(_read_pair, highs)
        return list(tqdm(read, total=len(highs), disable=None, desc="reading labels", unit="picture", leave=False))


def _read_pair(file: Path) -> Pair:
    low, high = read_rgb(file.with_name(file.name.removesuffix(HIGH) + LOW)), read_rgb(file)
    if high.shape != (SCALE * low.shape[0], SCALE * low.shape[1], 3):
        raise ValueError(f"{file}: {high.shape} for LR of {low.shape}; make the pair again with training.data.labels")
    return Pair(low, high)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("pictures", type=Path, help="folder of pictures")
    parser.add_argument("--network", type=Path, required=True, help="ONNX file of the stronger network, scale 2")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the pairs")
    parser.add_argument(
        "--scales", type=float, nargs="+", default=[1.0], help="sizes of the pictures, each for a pair (default: 1)"
    )
    parser.add_argument("--threads", type=int, help="cores (default: all)")
    given = parser.parse_args(arguments)
    if not given.network.is_file():
        parser.error(f"{given.network}: no such file; name an ONNX network")
    if not all(0 < scale <= 1 for scale in given.scales):
        parser.error("--scales: give numbers above 0, up to 1")
    try:
        written = label_pictures(given.pictures, given.network, given.out, scales=given.scales, threads=given.threads)
    except ValueError as error:
        sys.exit(f"labels: {error}")
    print(f"{given.out}: {written} pairs written")


if __name__ == "__main__":
    main()
