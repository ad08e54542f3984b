"""Entry points for untrusted input, each as a function of bytes that checks what it promises.

A target returns whether the bytes were read. It raises where an entry point neither gives what it promises
nor refuses in one line by a `ciir.errors.Error`: `python -m tests.fuzz.run` looks for bytes that make it.
"""

from __future__ import annotations

import asyncio
import io
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request

from ciir.errors import Error
from ciir.renderer.levels import round_levels
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.meshes.pose import MeshPose
from ciir.renderer.readers.registry import SUFFIXES
from ciir.renderer.writers.file_writer import FileWriter
from ciir.service.pipeline.displays.pictures import make_picture
from ciir.service.pipeline.focus.disparities import find_disparity
from ciir.service.pipeline.focus.planes import refocus
from ciir.service.pipeline.inspection.report import inspect
from ciir.service.pipeline.options import KINDS, NAMES, Options
from ciir.service.pipeline.run import reconstruct
from ciir.service.web import multipart
from ciir.service.web.routes import upload
from tests.fuzz import readers, seeds
from tests.fuzz.readers import LIMITS, BrokenPromise, check_pixels
from tests.fuzz.seeds import containers, displays, focus, gltf, gltf_extensions

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.types import Message

    from ciir.renderer.displays.pictures import Kind as DisplayKind
    from ciir.renderer.writers.stacks import Stack
    from ciir.service.jobs.job import Request as Job
    from ciir.service.pipeline.options import KindName

LONGEST_LINE = 600
"""Characters of a message: two names of 80, and a sentence."""


@dataclass(frozen=True)
class Target:
    """An entry point, and its seeds."""

    check: Callable[[bytes], object]
    """Raises an error where it refuses."""
    seeds: Callable[[], list[bytes]]

    def __call__(self, data: bytes) -> bool:
        """Whether `data` was read; `BrokenPromise`, or what the entry point raised, where it broke its promise."""
        try:
            self.check(data)
        except (Error, HTTPException) as error:
            line = str(error.detail) if isinstance(error, HTTPException) else str(error)
            if not line.isprintable() or not 10 <= len(line) <= LONGEST_LINE:
                raise BrokenPromise(f"no line of 10 to {LONGEST_LINE} characters: {line[:1000]!r}") from error
            return False
        return True


_OFF = seeds.off()[0]
_VIEWS = LightField(seeds.noise(60, 16, 3).reshape(1, 5, 12, 16, 3), is_ordered=True, depth_sense="cameras")


def asked(name: str, file: bytes) -> Callable[[bytes], None]:
    """The options' values, one a line by the order of `service.pipeline.options.NAMES`, to the end of the pipeline."""

    def check(data: bytes) -> None:
        values = zip(NAMES, data.decode("latin-1").split("\n"), strict=False)
        options = Options.parse({option: value for option, value in values if value.strip()})
        with FileWriter(io.BytesIO(), None) as writer:
            report = reconstruct(Bundle.from_upload(name, file, LIMITS), options, writer, max_pixels=20_000)
        if not report["views"]:
            raise BrokenPromise("a report without views")

    return check


def form(data: bytes) -> None:
    """A multipart form, in pieces as a network gives it."""
    _read_form(data, "reconstruction")


def display_form(data: bytes) -> None:
    """The form of a picture for a display, and that picture of a few views."""
    job = _read_form(data, "display")
    options = Options.parse(job.options)
    picture, _ = make_picture(_VIEWS, options, cast("DisplayKind | None", job.format), max_pixels=20_000)
    check_pixels(picture.pixels)


def plane_form(data: bytes) -> None:
    """The form of depth planes, and those of a few views."""
    job = _read_form(data, "plane")

    def write(stack: Stack) -> list[str]:
        for plane in stack.read():
            check_pixels(round_levels(plane, stack.dtype))
        return []

    refocus(_VIEWS, KINDS["plane"].parse(job.options), write, max_pixels=20_000)


def disparity_form(data: bytes) -> None:
    """The form of a disparity map, and that of a few views."""
    job = _read_form(data, "disparity")
    found, _ = find_disparity(_VIEWS, KINDS["disparity"].parse(job.options), max_pixels=20_000)
    if not np.isfinite(found.disparity).all():
        raise BrokenPromise("a disparity that is not finite")


def inspected(data: bytes) -> None:
    """What any file is, as JSON; each candidate's options are in range."""
    report = inspect(Bundle.from_upload("upload", data, LIMITS), Options())
    json.dumps(report, allow_nan=False, ensure_ascii=False).encode()
    for candidate in report["candidates"]:
        KINDS["reconstruction"].parse(candidate["options"])


def _read_form(data: bytes, kind: KindName) -> Job:
    async def read() -> Job:
        pieces = [data[i : i + 61] for i in range(0, len(data), 61)] or [b""]

        async def receive() -> Message:
            return {"type": "http.request", "body": pieces.pop(0), "more_body": bool(pieces)}

        headers = [(b"content-type", b"multipart/form-data; boundary=" + seeds.BOUNDARY)]
        request = Request({"type": "http", "method": "POST", "path": "/", "headers": headers}, receive)
        given = await multipart.read_form(request)
        try:
            return upload.parse_form(given.multi_items(), KINDS[kind]).request
        finally:
            await given.close()

    return asyncio.run(read())


TARGETS: dict[str, Target] = {
    "png": Target(readers.picture("png"), seeds.png),
    "png-sealed": Target(readers.sealed_png, seeds.png),
    "jpeg": Target(readers.picture("jpg"), seeds.jpegs),
    "tiff": Target(readers.picture("tif"), seeds.tiffs),
    "webp": Target(readers.picture("webp"), seeds.webps),
    "ppm": Target(readers.picture("ppm"), seeds.netpbms),
    "bmp": Target(readers.picture("bmp"), seeds.bmps),
    "lytro": Target(readers.container(SUFFIXES[".lfp"]), containers.lytro),
    "lytro-values": Target(readers.lytro_values, lambda: [bytes([number, 0, 3, 0]) for number in range(2)]),
    "ktx2": Target(readers.picture("ktx2"), gltf_extensions.ktx2),
    "zip": Target(readers.archive, seeds.zips),
    "views": Target(readers.view_set, seeds.view_sets),
    "glb": Target(readers.mesh(SUFFIXES[".glb"]), lambda: [*gltf.glb(), *gltf_extensions.textured()]),
    "gltf": Target(readers.mesh(SUFFIXES[".gltf"], "a.bin", "x.png"), gltf.gltf),
    "gltf-pose": Target(readers.mesh(SUFFIXES[".gltf"], "a.bin", pose=MeshPose(0.5, "0")), gltf_extensions.pose),
    "gltf-values": Target(readers.gltf_values, gltf_extensions.value_edits),
    "meshopt": Target(readers.mesh(SUFFIXES[".glb"]), gltf_extensions.packed),
    "draco": Target(readers.mesh(SUFFIXES[".glb"]), gltf.draco),
    "obj": Target(readers.mesh(SUFFIXES[".obj"], "a.mtl", "x.png"), seeds.obj),
    "ply": Target(readers.mesh(SUFFIXES[".ply"], "x.png"), seeds.ply),
    "stl": Target(readers.mesh(SUFFIXES[".stl"]), seeds.stl),
    "off": Target(readers.mesh(SUFFIXES[".off"]), seeds.off),
    "dae": Target(readers.mesh(SUFFIXES[".dae"], "x.png"), seeds.dae),
    "3mf": Target(readers.mesh(SUFFIXES[".3mf"]), seeds.threemf),
    "npy": Target(readers.container(SUFFIXES[".npy"]), containers.npy),
    "npz": Target(readers.container(SUFFIXES[".npz"]), containers.npz),
    "npz-arrays": Target(readers.npz_arrays, containers.npz_arrays),
    "mat": Target(readers.container(SUFFIXES[".mat"]), containers.mat),
    "tiff-stack": Target(readers.container(SUFFIXES[".tif"]), containers.tiff_stacks),
    "eslf": Target(readers.eslf, containers.eslf),
    "lenslet": Target(readers.lenslet, containers.lenslets),
    "h5": Target(readers.container(SUFFIXES[".h5"]), containers.hdf5),
    "mp4": Target(readers.container(SUFFIXES[".mp4"]), containers.mp4),
    "mkv": Target(readers.container(SUFFIXES[".mkv"]), containers.matroska),
    "gif": Target(readers.container(SUFFIXES[".gif"]), containers.gif),
    "quilt": Target(readers.quilt, displays.quilts),
    "display": Target(readers.display, displays.panels),
    "calibration": Target(readers.calibration, displays.calibrations),
    "any": Target(readers.anything, lambda: [*seeds.off(), *seeds.stl(), *gltf.glb(), *seeds.png(), *seeds.zips()]),
    "inspection": Target(
        inspected, lambda: [*seeds.off(), *gltf.glb(), *seeds.png(), *seeds.repeating(), *seeds.zips()]
    ),
    "options-eia": Target(asked("upload.png", readers.EIA), seeds.options),
    "options-mesh": Target(asked("upload.off", _OFF), seeds.options),
    "multipart": Target(form, seeds.multipart),
    "display-form": Target(display_form, displays.forms),
    "plane-form": Target(plane_form, focus.planes),
    "disparity-form": Target(disparity_form, focus.disparities),
}
"""Name -> entry point."""
