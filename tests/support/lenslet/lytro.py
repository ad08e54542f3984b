"""Files in the containers of Lytro's cameras, with pictures that are cast ray by ray."""

from __future__ import annotations

import hashlib
import json
import math
import struct

import numpy as np

from ciir.renderer.readers.lytro.metadata import CELL

GAINS = {"r": 1.375, "gr": 1.0, "gb": 1.0, "b": 1.15}
CCM = [1.5, -0.3, -0.2, -0.2, 1.4, -0.2, 0.0, -0.5, 1.5]


def make_metadata(grid, size, model="F01", gamma=1 / 2.4):
    """Makes metadata like that of an F01 or an Illum, for a picture of `size` pixels under the hexagonal `grid`."""
    bits, order, first, black, white = {
        "F01": (12, "big", "b", 168, 4095),
        "ILLUM": (10, "little", "gr", 64, 1023),
    }[model]
    details = {
        "pixelFormat": {"rightShift": 0, "black": dict.fromkeys(CELL, black), "white": dict.fromkeys(CELL, white)},
        "pixelPacking": {"endianness": order, "bitsPerPixel": bits},
        "mosaic": {"tile": "r,gr:gb,b", "upperLeftPixel": first},
    }
    image = {"width": size[1], "height": size[0], "orientation": 1}
    ccm = "ccmRgbToSrgbArray" if model == "F01" else "ccm"
    image["color"] = {ccm: CCM, "gamma": gamma, "whiteBalanceGain": GAINS}
    image |= {"rawDetails": details} if model == "F01" else details
    middle, pixel = np.array(size) // 2, 1.4e-6
    near = (grid.find_centers(*grid.find_nearest(middle)) - middle) * pixel
    mla = {
        "tiling": "hexUniformRowMajor",
        "lensPitch": grid.pitch * pixel,
        "rotation": math.radians(grid.rotation),
        "scaleFactor": {"x": 1, "y": grid.stretch},
        "sensorOffset": {"x": near[1], "y": near[0], "z": 0.0},
    }
    return {"image": image, "devices": {"sensor": {"pixelPitch": pixel}, "mla": mla}, "camera": {"model": model}}


def expose(picture, metadata):
    """Computes the mosaic `(H, W)` from which `picture`, RGB from 0 to 255, should be developed."""
    image = metadata["image"]
    details = image.get("rawDetails", image)
    light = (picture / 255) ** (1 / image["color"]["gamma"]) @ np.linalg.inv(np.reshape(CCM, (3, 3))).T
    first = CELL.index(details["mosaic"]["upperLeftPixel"])
    y, x = np.indices(light.shape[:2])
    cell = (first // 2 + y) % 2 * 2 + (first + x) % 2  # r, gr, gb, b
    seen = np.take_along_axis(light, np.array([0, 1, 1, 2])[cell][..., None], 2)[..., 0]
    seen /= np.array([GAINS[colour] for colour in CELL])[cell]
    black, white = details["pixelFormat"]["black"]["r"], details["pixelFormat"]["white"]["r"]
    return np.clip(np.rint(black + (white - black) * seen), 0, white).astype(np.uint16)


def pack(mosaic, bits):
    """Packs the mosaic into bytes, pixel by pixel, as the slow reference."""
    packed = bytearray()
    values = mosaic.ravel().tolist()
    if bits == 12:
        for a, b in zip(values[::2], values[1::2], strict=True):
            packed += bytes((a >> 4, (a & 15) << 4 | b >> 8, b & 255))
    else:
        for four in zip(*(values[n::4] for n in range(4)), strict=True):
            packed += bytes(value >> 2 for value in four)
            packed.append(sum((value & 3) << 2 * n for n, value in enumerate(four)))
    return bytes(packed)


def write_container(packed, metadata, model="F01"):
    """Writes a `.lfp` of an F01 or a `.lfr` of an Illum, with as many sections as theirs have."""
    contents = [packed, json.dumps(metadata).encode(), b'{"camera": {"serialNumber": "A1"}}']
    refs = [f"sha1-{hashlib.sha1(content, usedforsecurity=False).hexdigest()}" for content in contents]
    frame = {"frame": dict(zip(("imageRef", "metadataRef", "privateMetadataRef"), refs, strict=True))}
    table = {"picture": {"frameArray": [frame]}} if model == "F01" else {"frames": [frame], "thumbnails": []}
    head = b"\x89LFP\r\n\x1a\n\0\0\0\x01" + bytes(4)
    contents_table = json.dumps(table).encode()
    contents_table += b" " * ((11 - len(contents_table)) % 16)  # imageio assumes the 5 zeros after an F01's table
    listed = _write_section(b"M", contents_table)
    chunks = [_write_section(b"C", content) for content in contents]
    if model == "F01":
        return head + listed + b"".join(chunks)
    others = [_write_section(b"C", b"other %d" % number) for number in range(8)]
    return head + b"".join(chunks + others) + listed


def _write_section(kind, content):
    name = f"sha1-{hashlib.sha1(content, usedforsecurity=False).hexdigest()}".encode()
    section = b"\x89LF" + kind + b"\r\n\x1a\n" + bytes(4) + struct.pack(">I", len(content)) + name + bytes(35) + content
    return section + bytes(-len(section) % 16)
