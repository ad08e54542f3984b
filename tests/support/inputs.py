"""Small meshes, pictures and zips as bytes, and inputs that every entry point must refuse."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib

import numpy as np

from ciir.renderer.writers.pictures import encode_png

CUBE = b"""OFF
8 6 0
-1 -1 -1\n1 -1 -1\n1 1 -1\n-1 1 -1\n-1 -1 1\n1 -1 1\n1 1 1\n-1 1 1
4 4 5 6 7\n4 1 0 3 2\n4 5 1 2 6\n4 0 4 7 3\n4 7 6 2 3\n4 0 1 5 4
"""


CUBE_OBJ = b"""
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 5 6 7 8\nf 2 1 4 3\nf 6 2 3 7\nf 1 5 8 4\nf 8 7 3 4\nf 1 2 6 5
"""
"""A cube for new processes, because its reader doesn't import trimesh, which takes most of a second."""


def make_picture(height, width, channels=3, dtype=np.uint8, seed=0):
    """Makes a picture of noise, so that swapped pixels are noticed."""
    top = np.iinfo(dtype).max
    return np.random.default_rng(seed).integers(0, top, (height, width, channels), dtype, endpoint=True)


def make_zip(files):
    """Makes the bytes of a zip that holds `files`, name -> bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def make_netpbm(stored, white):
    """Makes a binary PPM or PGM of levels `(height, width, 3)` or `(height, width, 1)` as stored, up to `white`."""
    height, width, channels = stored.shape
    header = f"P{5 if channels == 1 else 6}\n# made by a test\n{width} {height}\n{white}\n"
    return header.encode() + stored.astype(np.uint8 if white < 256 else ">u2").tobytes()


def make_png_header(height, width):
    """Makes a PNG whose header claims a size, without pixels."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


def make_off(vertices, faces):
    """Makes the bytes of an OFF mesh of triangles."""
    lines = [f"OFF\n{len(vertices)} {len(faces)} 0"]
    lines += [" ".join(map(str, v)) for v in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
    return "\n".join(lines).encode() + b"\n"


def make_glb(extension):
    """Makes a GLB without content that requires `extension`."""
    body = json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": [extension], "extensionsUsed": [extension]})
    chunk = body.encode().ljust(-(-len(body) // 4) * 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(chunk)) + struct.pack("<I4s", len(chunk), b"JSON") + chunk


EIA = make_picture(24, 36, seed=1)  # 6x9 lenses of 4x4 pixels
EIA_PNG = encode_png(EIA)
SQUARE = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]
TWO = [(0, 1, 2), (1, 2, 3)]

BAD_INPUTS = {
    "text": ("notes.txt", b"hello", {}, 415, ["notes.txt|upload.txt", "glb"]),
    "text named as a mesh": ("a.obj", b"hello\n", {}, 415, ["a.obj|upload.obj"]),
    "empty file": ("a.png", b"", {}, 422, ["empty"]),
    "png named glb": ("a.glb", EIA_PNG, {}, 415, ["PNG", "GLB"]),
    "truncated png": ("a.png", EIA_PNG[:200], {"lenses": "6x9"}, 422, ["truncated|corrupt|too early"]),
    "truncated glb": ("a.glb", make_glb("x")[:30], {}, 422, ["a.glb|upload.glb"]),
    "unknown extension": ("a.glb", make_glb("EXT_unknown"), {}, 415, ["EXT_unknown"]),
    "no faces": ("a.off", make_off(SQUARE, []), {}, 422, ["a.off|upload.off"]),
    "nan vertex": (
        "a.off",
        make_off([*SQUARE[:3], ("nan", 0, 0)], [(0, 1, 2), (1, 2, 3)]),
        {},
        422,
        ["finite|nan|NaN"],
    ),
    "huge vertex": ("a.off", make_off([*SQUARE[:3], (1e30, 0, 0)], TWO), {}, 422, ["1e"]),
    "zero area": ("a.off", make_off([(0, 0, 0), (1, 1, 1), (2, 2, 2)], [(0, 1, 2)]), {}, 422, ["area|surface"]),
    "wide png": ("a.png", make_png_header(10, 1_000_000), {"lenses": "1x1"}, 413, ["1000000|1,000,000", "limit"]),
    "escaping zip": ("a.zip", make_zip({"../evil.obj": b"v 0 0 0\n"}), {}, 422, ["evil.obj"]),
    "swelling zip": ("a.zip", make_zip({"a.obj": bytes(2**24)}), {}, 413, ["times its size|limit|at most"]),
    "empty zip": ("a.zip", make_zip({}), {}, 422, ["a.zip|upload.zip"]),
    "grid that doesn't divide": ("a.png", EIA_PNG, {"lenses": "5x9"}, 422, ["5x9", "24x36"]),
    "no grid": ("a.png", EIA_PNG, {}, 422, ["lenses"]),
    "scale 0": ("a.off", CUBE, {"scale": "0"}, 422, ["scale", "1 to 8"]),
    "scale of the model": ("a.off", CUBE, {"scale": "3", "model": "paper"}, 422, ["scale", "2"]),
    "unknown model": ("a.off", CUBE, {"model": "gpt"}, 422, ["gpt", "bicubic"]),
    "no lenses": ("a.off", CUBE, {"lenses": "0x5"}, 422, ["lenses"]),
    "too many pixels": ("a.off", CUBE, {"pixels": "99999x5"}, 422, ["99999", "1 to"]),
    "view that isn't there": ("a.off", CUBE, {"views": "99,0"}, 422, ["99,0", "14"]),
    "views not understood": ("a.off", CUBE, {"views": "some"}, 422, ["some", "center"]),
    "negative pitch": ("a.off", CUBE, {"pitch": "-1"}, 422, ["pitch"]),
    "infinite delta": ("a.off", CUBE, {"delta": "inf"}, 422, ["delta"]),
    "direct picture": ("a.png", EIA_PNG, {"lenses": "6x9", "strategy": "direct"}, 422, ["direct", "mesh"]),
    "picture with a backend": ("a.png", EIA_PNG, {"lenses": "6x9", "backend": "raytrace"}, 422, ["backend"]),
    "optical mesh": ("a.off", CUBE, {"pickup": "optical"}, 422, ["pickup"]),
    "too many samples": ("a.off", CUBE, {"lenses": "4000x4000", "strategy": "direct"}, 413, ["8000x8000", "samples"]),
    "too large a view": ("a.off", CUBE, {"lenses": "4096x4096", "model": "bicubic", "scale": "8"}, 413, ["fewer"]),
}
"""Description -> (file name, bytes, options, HTTP status, parts that the message's only line must contain)."""


def contains_all(line, parts):
    """Returns whether `line` contains each of `parts`, in which `|` separates alternatives."""
    return all(any(option in line for option in part.split("|")) for part in parts)


def make_profile(name: str, *, is_v4: bool = False, before: int = 0) -> bytes:
    """Makes a colour profile that holds only its name, after `before` bytes."""
    if is_v4:
        text = name.encode("utf-16-be")
        tag = b"mluc" + struct.pack(">IIIHHII", 0, 1, 12, 0x656E, 0x5553, len(text), 28) + text
    else:
        tag = b"desc" + struct.pack(">II", 0, len(name) + 1) + name.encode("latin-1") + b"\0"
    return bytes(128) + struct.pack(">I4sII", 1, b"desc", 144 + before, len(tag)) + bytes(before) + tag
