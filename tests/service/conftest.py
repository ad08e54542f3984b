"""Small inputs as bytes, a stand-in for a light-field network, and a real server."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import struct
import subprocess
import sys
import zipfile
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ciir.models import catalogue
from ciir.models.card import Tensor
from ciir.renderer.readers.pictures import encode_png

if TYPE_CHECKING:
    from pathlib import Path

CUBE = b"""OFF
8 6 0
-1 -1 -1\n1 -1 -1\n1 1 -1\n-1 1 -1\n-1 -1 1\n1 -1 1\n1 1 1\n-1 1 1
4 4 5 6 7\n4 1 0 3 2\n4 5 1 2 6\n4 0 4 7 3\n4 7 6 2 3\n4 0 1 5 4
"""


def picture(height, width, channels=3, dtype=np.uint8, seed=0):
    """Noise: no two pixels alike, so that nothing can be swapped unseen."""
    top = np.iinfo(dtype).max
    return np.random.default_rng(seed).integers(0, top, (height, width, channels), dtype, endpoint=True)


def zipped(files):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def png_header(height, width):
    """A PNG that claims a size and holds nothing."""

    def chunk(kind, data):
        import zlib

        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


def off(vertices, faces):
    lines = [f"OFF\n{len(vertices)} {len(faces)} 0"]
    lines += [" ".join(map(str, v)) for v in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
    return "\n".join(lines).encode() + b"\n"


def glb_needing(extension):
    """A GLB that requires an extension nobody reads."""
    body = json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": [extension], "extensionsUsed": [extension]})
    chunk = body.encode().ljust(-(-len(body) // 4) * 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(chunk)) + struct.pack("<I4s", len(chunk), b"JSON") + chunk


EIA = picture(24, 36, seed=1)  # 6x9 lenses of 4x4 pixels
SQUARE = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]

# Issue item 7: what it is -> (file name, bytes, options, HTTP status, words that the one line must hold)
BAD_INPUTS = {
    "text": ("notes.txt", b"hello", {}, 415, ["notes.txt|upload.txt", "glb"]),
    "text named as a mesh": ("a.obj", b"hello\n", {}, 415, ["a.obj|upload.obj"]),
    "empty file": ("a.png", b"", {}, 422, ["empty"]),
    "png named glb": ("a.glb", encode_png(EIA), {}, 415, ["PNG", "GLB"]),
    "truncated png": ("a.png", encode_png(EIA)[:200], {"lenses": "6x9"}, 422, ["truncated|corrupt|too early"]),
    "truncated glb": ("a.glb", glb_needing("x")[:30], {}, 422, ["a.glb|upload.glb"]),
    "unknown extension": ("a.glb", glb_needing("EXT_nobody"), {}, 415, ["EXT_nobody"]),
    "no faces": ("a.off", off(SQUARE, []), {}, 422, ["a.off|upload.off"]),
    "nan vertex": ("a.off", off([*SQUARE[:3], ("nan", 0, 0)], [(0, 1, 2), (1, 2, 3)]), {}, 422, ["finite|nan|NaN"]),
    "huge vertex": ("a.off", off([*SQUARE[:3], (1e30, 0, 0)], [(0, 1, 2), (1, 2, 3)]), {}, 422, ["1e"]),
    "zero area": ("a.off", off([(0, 0, 0), (1, 1, 1), (2, 2, 2)], [(0, 1, 2)]), {}, 422, ["area|surface"]),
    "wide png": ("a.png", png_header(10, 1_000_000), {"lenses": "1x1"}, 413, ["1000000|1,000,000", "limit"]),
    "escaping zip": ("a.zip", zipped({"../evil.obj": b"v 0 0 0\n"}), {}, 422, ["evil.obj"]),
    "swelling zip": ("a.zip", zipped({"a.obj": bytes(2**24)}), {}, 413, ["times its size|limit|at most"]),
    "empty zip": ("a.zip", zipped({}), {}, 422, ["a.zip|upload.zip"]),
    "grid that doesn't divide": ("a.png", encode_png(EIA), {"lenses": "5x9"}, 422, ["5x9", "24x36"]),
    "no grid": ("a.png", encode_png(EIA), {}, 422, ["lenses"]),
    "scale 0": ("a.off", CUBE, {"scale": "0"}, 422, ["scale", "1 to 8"]),
    "scale of the model": ("a.off", CUBE, {"scale": "3", "model": "paper"}, 422, ["scale", "2"]),
    "unknown model": ("a.off", CUBE, {"model": "gpt"}, 422, ["gpt", "bicubic"]),
    "no lenses": ("a.off", CUBE, {"lenses": "0x5"}, 422, ["lenses"]),
    "too many pixels": ("a.off", CUBE, {"pixels": "99999x5"}, 422, ["99999", "1 to"]),
    "view that isn't there": ("a.off", CUBE, {"views": "99,0"}, 422, ["99,0", "14"]),
    "views not understood": ("a.off", CUBE, {"views": "some"}, 422, ["some", "center"]),
    "negative pitch": ("a.off", CUBE, {"pitch": "-1"}, 422, ["pitch"]),
    "infinite delta": ("a.off", CUBE, {"delta": "inf"}, 422, ["delta"]),
    "direct picture": ("a.png", encode_png(EIA), {"lenses": "6x9", "strategy": "direct"}, 422, ["direct", "mesh"]),
    "picture with a backend": ("a.png", encode_png(EIA), {"lenses": "6x9", "backend": "raytrace"}, 422, ["backend"]),
    "optical mesh": ("a.off", CUBE, {"pickup": "optical"}, 422, ["pickup"]),
    "too many samples": ("a.off", CUBE, {"lenses": "4000x4000", "strategy": "direct"}, 413, ["8000x8000", "samples"]),
    "too large a view": ("a.off", CUBE, {"lenses": "4096x4096", "model": "bicubic", "scale": "8"}, 413, ["limit"]),
}


class StandIn:
    """Each pixel twice along each side, halfway to the mean luma of the window's views: a wrong view would show."""

    name, scale, radius, threads = catalogue.FIELD, 2, 0, 1
    doubt = 0.3

    def __call__(self, image, around, rows, cols, *, cores=None):
        there = np.outer(rows, cols).reshape(1, -1, 1, 1)
        mean = (around * there).sum(1, keepdims=True) / there.sum()
        return ((image + mean) / 2).repeat(2, axis=2).repeat(2, axis=3), np.full_like(mean, self.doubt)


def as_the_stand_in_has_it(views, view):
    """Its picture of `view`, of views `(V, U, H, W, C)`, in plain loops and not rounded."""
    weights = [0.299, 0.587, 0.114] if views.shape[4] == 3 else [1.0]
    window = [
        views[v, u] @ weights
        for v in range(view[0] - 2, view[0] + 3)
        for u in range(view[1] - 2, view[1] + 3)
        if 0 <= v < views.shape[0] and 0 <= u < views.shape[1]
    ]
    large = (views[view] + np.mean(window, axis=0)[..., None]) / 2
    return large.repeat(2, axis=0).repeat(2, axis=1)


@pytest.fixture
def stand_in(monkeypatch):
    """The catalogue with `StandIn` as `field`, whatever is shipped, and no int8 twins in place of what is named."""
    entries = [entry for entry in catalogue.entries() if entry.name != catalogue.FIELD]
    (fast,) = (entry for entry in entries if entry.name == catalogue.DEFAULT)
    further = (Tensor("around", ("batch", 25, "height", "width"), "float32", 0.0, 1.0),)
    card = dataclasses.replace(fast.card, name=catalogue.FIELD, further=further)
    entries.insert(0, dataclasses.replace(fast, name=catalogue.FIELD, card=card))
    load = catalogue.load_light_field
    network = StandIn()

    def load_light_field(name=catalogue.FIELD, *, scale=2, threads=None):
        return network if (name, scale) == (catalogue.FIELD, 2) else load(name, scale=scale, threads=threads)

    monkeypatch.setattr(catalogue, "entries", lambda: entries)
    monkeypatch.setattr(catalogue, "quickest", lambda name: name)
    monkeypatch.setattr(catalogue, "load_light_field", load_light_field)
    return network


def holds(line, words):
    """Whether `line` holds each of `words`, where `|` separates ways to say one."""
    return all(any(way in line for way in word.split("|")) for word in words)


def pytest_generate_tests(metafunc):
    if "bad_input" in metafunc.fixturenames:
        metafunc.parametrize("bad_input", BAD_INPUTS.values(), ids=BAD_INPUTS)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Nothing is kept in the user's cache folder, nor taken from there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CIIR_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def samples():
    """This module: test modules can't import it."""
    return sys.modules[__name__]


@pytest.fixture
def cube_file(tmp_path):
    path = tmp_path / "cube.off"
    path.write_bytes(CUBE)
    return path


@pytest.fixture
def eia_file(tmp_path):
    path = tmp_path / "eia.png"
    path.write_bytes(encode_png(EIA))
    return path


def python(*argv, **options):
    """A fresh Python, finished; its output as text."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
    return subprocess.run([sys.executable, *map(str, argv)], check=False, text=True, **options)  # noqa: S603 - our own


@contextmanager
def launched(log: Path, *words, **environment):
    """`ciir` as a process of its own, with a folder beside `log`, where its output goes; ended at the end, in order."""
    import os

    environment = {"CIIR_FOLDER": str(log.with_name("service"))} | environment
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 - our own
            [sys.executable, "-m", "ciir", *words], stdout=output, stderr=output, env=os.environ | environment
        )
    try:
        yield process
    finally:
        process.terminate()
        assert process.wait(30) == 0, log.read_text()


@contextmanager
def serving(log: Path, **environment):
    """`ciir serve` on a free port; yields its URL once it is ready. It stops in order when it is told to."""
    import time

    import httpx2

    with launched(log, "serve", "--port", "0", **environment) as process:
        deadline = time.monotonic() + 60
        while (found := re.search(r"http://[\d.]+:\d+", log.read_text())) is None:
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.05)
        while httpx2.get(f"{found[0]}/readyz").status_code != 200:
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.05)
        yield found[0]
    assert "Application shutdown complete" in log.read_text()


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("server") / "log") as url:
        yield url
