"""The formats of disparity maps.

Numbers are in the sense of the HCI 4D light field benchmark: pixel x of the view is found at x - d in the camera to its
right, so larger is nearer.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import replacing
from ciir.renderer.writers.depth.colors import color_map
from ciir.renderer.writers.file_types import BINARY, FileType, index_suffixes
from ciir.renderer.writers.pictures import png

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from ciir.renderer.focus.disparity import DisparityMap

    Map = NDArray[np.float32]
    Encoded = tuple[bytes, dict[str, float]]

CONFIDENCE = "_confidence"
"""Suffix of a confidence map's name after that of its disparity map."""
SHOWN = (0.005, 0.995)
"""The quantiles of a map between which colours lie, so that single wrong pixels don't use up all of them."""


@dataclass(frozen=True)
class MapFormat(FileType):
    """A format of `(H, W)` numbers."""

    encode: Callable[[Map], Encoded]
    """Returns the file and what a reader of it needs to know, for the report."""


def encode_disparity(found: DisparityMap, name: str) -> tuple[bytes, bytes, dict[str, Any]]:
    """Returns the files of the disparity and of its confidence, in the format `name`, and how to read the first.

    Raises `InvalidOption` for an unknown format.
    """
    encode = _get_format(name).encode
    data, reading = encode(found.hci)
    confidence, _ = encode(found.confidence)
    return data, confidence, {"format": name, "sense": "larger is nearer", **reading}


def write_disparity(path: Path, found: DisparityMap, name: str | None = None) -> dict[str, Any]:
    """Writes the disparity to `path`, and next to it the confidence, `NAME_confidence`; returns how to read both.

    `name`: a format of `FORMATS`, by default the one of the path's suffix. Raises `InvalidOption` if the path can't be
    written, and as `find_format` does.
    """
    entry = find_format(path, name)
    data, confidence, reading = encode_disparity(found, entry.name)
    beside = path.with_stem(path.stem + CONFIDENCE)
    for place, content in ((path, data), (beside, confidence)):
        with replacing(place) as file:
            file.write(content)
    return {"file": path.name, "confidence": beside.name, **reading}


def find_format(path: Path, name: str | None = None) -> MapFormat:
    """Returns the format `name`, by default the one of the path's suffix.

    Raises `InvalidOption` if there is none, and if a path with that format has another suffix.
    """
    found = BY_SUFFIX if name is None else index_suffixes([_get_format(name)])
    if path.suffix.lower() not in found:
        raise InvalidOption(f"{path}: a disparity map can't have this name; end it with {', '.join(found)}")
    return found[path.suffix.lower()]


def _get_format(name: str) -> MapFormat:
    if name not in FORMATS:
        raise InvalidOption(f"format: {name[:40]!r} holds no disparity; give {', '.join(FORMATS)}")
    return FORMATS[name]


def _encode_pfm(values: Map) -> Encoded:
    """Encodes a portable float map (netpbm.sourceforge.net/doc/pfm.html): rows from the bottom, little endian (scale
    -1).
    """
    height, width = values.shape
    return f"Pf\n{width} {height}\n-1.0\n".encode() + values[::-1].astype("<f4").tobytes(), {}


def _encode_tiff(values: Map) -> Encoded:
    """Encodes one page of floats (TIFF 6.0, section 19), uncompressed, which ImageJ and MATLAB read, too."""
    import tifffile  # imported here because the service's parent process doesn't need it

    from ciir.renderer.writers.pictures import tiff

    file = io.BytesIO()
    page = tiff.describe_page(1) | {"compression": None, "predictor": None}
    tifffile.imwrite(file, values.astype("<f4"), byteorder="<", **page)
    return file.getvalue(), {}


def _encode_png(values: Map) -> Encoded:
    """Encodes 16-bit levels: the value is `offset + scale * level`, with both in text chunks of these names."""
    low, high = float(values.min()), float(values.max())
    reading = {"scale": max(high - low, 1e-6) / 0xFFFF, "offset": low}
    levels = ((values - low) / reading["scale"]).round().clip(0, 0xFFFF).astype(np.uint16)
    return png.encode(levels, {name: repr(number) for name, number in reading.items()}), reading


def _encode_npy(values: Map) -> Encoded:
    file = io.BytesIO()
    np.save(file, values.astype("<f4"), allow_pickle=False)
    return file.getvalue(), {}


def _encode_colors(values: Map) -> Encoded:
    """Encodes the colours of `color_map` between the quantiles `SHOWN`."""
    low, high = np.quantile(values, SHOWN).tolist()
    return png.encode(color_map(values, low, high)), {"darkest": low, "brightest": high}


FORMATS = {
    entry.name: entry
    for entry in (
        MapFormat("pfm", (".pfm",), "image/x-portable-floatmap", _encode_pfm),
        MapFormat("tiff", (".tif", ".tiff"), "image/tiff", _encode_tiff),
        MapFormat("png", (".png",), "image/png", _encode_png),
        MapFormat("npy", (".npy",), BINARY, _encode_npy),
        MapFormat("viridis", (".png",), "image/png", _encode_colors),
    )
}
"""The formats by name. If several have the same suffix, the first one is its format."""
BY_SUFFIX = index_suffixes(FORMATS.values())
"""The formats by suffix."""
