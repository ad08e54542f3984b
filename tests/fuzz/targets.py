"""Entry points for untrusted input, each as a function of bytes that checks what it promises.

A target returns whether the bytes were read. It raises where an entry point neither gives what it promises
nor refuses in one line by a `ciir.errors.Error`: `python -m tests.fuzz.run` looks for bytes that make it.
"""

from __future__ import annotations

import asyncio
import io
import json
import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request

from ciir.errors import Error
from ciir.renderer.displays.integral import parse_display
from ciir.renderer.displays.lenticular import parse_calibration
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs, meshes, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose
from ciir.renderer.readers.png import SIGNATURE
from ciir.renderer.readers.registry import SUFFIXES, Format, identify
from ciir.renderer.writers.formats import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.stacks import Stack, round_plane
from ciir.service.pipeline.displays.pictures import make_picture
from ciir.service.pipeline.focus.disparities import find_disparity
from ciir.service.pipeline.focus.planes import refocus
from ciir.service.pipeline.inspection.report import inspect
from ciir.service.pipeline.options import KINDS, NAMES, Options
from ciir.service.pipeline.run import reconstruct
from ciir.service.web import multipart
from ciir.service.web.routes import upload
from tests.fuzz import seeds
from tests.fuzz.mutate import edit_values
from tests.fuzz.seeds import containers, displays, focus, gltf, gltf_extensions, pack, parts

if TYPE_CHECKING:
    from collections.abc import Callable

    from starlette.types import Message

    from ciir.renderer.displays.pictures import Kind as DisplayKind
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.scene import Scene
    from ciir.service.jobs.job import Request as Job
    from ciir.service.pipeline.options import KindName

LIMITS = Limits(files=64, bytes=2**24, pixels=2**20, set_bytes=2**22, triangles=20_000, views=64)
"""Under the service's own, so that inputs at a limit are found, and cost little."""
LONGEST_LINE = 600
"""Characters of a message: two names of 80, and a sentence."""


class BrokenPromise(AssertionError):  # noqa: N818 - the cause is the name
    """An entry point broke its promise."""


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


def picture(suffix: str) -> Callable[[bytes], None]:
    """A picture of a kind by itself."""

    def check(data: bytes) -> None:
        identify(f"upload.{suffix}", data)
        _check_pixels(pictures.decode(data, name="upload", max_pixels=LIMITS.pixels))

    return check


def seal_png(data: bytes) -> bytes:
    """A PNG with its checksums made right: what is behind them is reached."""
    made, offset = [SIGNATURE], len(SIGNATURE)
    while offset + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, offset)
        body = data[offset + 8 : offset + 8 + length]
        made.append(struct.pack(">I4s", len(body), kind) + body + struct.pack(">I", zlib.crc32(kind + body)))
        offset += 12 + length
    return b"".join(made)


def sealed_png(data: bytes) -> None:
    """A PNG with the right checksums."""
    picture("png")(seal_png(data))


def mesh(kind: Format, *beside: str, pose: MeshPose = AS_STORED) -> Callable[[bytes], None]:
    """A mesh, and the files `beside` it where the input holds several parts."""

    def check(data: bytes) -> None:
        main, *others = parts(data)
        name = f"main.{kind.extension}"
        if identify(name, main) is kind:
            files = {name: main, **dict(zip(beside, others, strict=False))}
            _check_scene(meshes.read(Bundle(name, name, files, LIMITS), kind, pose=pose))

    return check


def gltf_values(data: bytes) -> None:
    """Values of a glTF's JSON, changed as bytes say: the first one chooses the file, and whether it is posed."""
    which, *_ = data or b"\0"
    made = gltf_extensions.documents()
    text, binary = made[which % len(made)]
    document = json.loads(text)
    edit_values(document, data[1:])
    pose = MeshPose(0.5, "0") if which >= 128 else AS_STORED
    mesh(SUFFIXES[".gltf"], "a.bin", pose=pose)(pack(json.dumps(document).encode(), binary))


def lytro_values(data: bytes) -> None:
    """Values of a Lytro file's metadata, changed as bytes say: the first one chooses the camera."""
    which, *_ = data or b"\0"
    container(SUFFIXES[".lfp"])(containers.lytro(data[1:])[which % 2])


def archive(data: bytes) -> None:
    """A zip as it comes in."""
    _check_content(inputs.read(Bundle.from_upload("upload.zip", data, LIMITS), Layout(lenses=(1, 1))))


def anything(data: bytes) -> None:
    """A file without a suffix: its kind follows from its content."""
    _check_content(inputs.read(Bundle.from_upload("upload", data, LIMITS), Layout(lenses=(1, 1))))


def container(kind: Format) -> Callable[[bytes], None]:
    """A file that holds a whole light field."""
    name = f"upload.{kind.extension}"
    return lambda data: _check_content(inputs.read(Bundle.from_upload(name, data, LIMITS), Layout()))


def npz_arrays(data: bytes) -> None:
    """An npz of arrays: their names, one a line, and the arrays; its checksums are right."""
    listed, *contents = parts(data)
    names = [name for name in listed.decode("latin-1").split("\n") if name]
    container(SUFFIXES[".npz"])(seeds.zipped(dict(zip(names, contents, strict=False))))


def eslf(data: bytes) -> None:
    """A picture that is called as Lytro's."""
    _check_content(inputs.read(Bundle.from_upload("upload_eslf.png", seal_png(data), LIMITS), Layout()))


def view_set(data: bytes) -> None:
    """A set of views: their names, one a line, and their pictures."""
    listed, *contents = parts(data)
    names = listed.decode("latin-1").split("\n")
    _check_content(inputs.read(Bundle("upload.zip", None, dict(zip(names, contents, strict=False)), LIMITS)))


_EIA = encode_png(seeds.noise(24, 36, 3))
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
    _check_pixels(picture.pixels)


def plane_form(data: bytes) -> None:
    """The form of depth planes, and those of a few views."""
    job = _read_form(data, "plane")

    def write(stack: Stack) -> list[str]:
        for plane in stack.read():
            _check_pixels(round_plane(plane, stack.dtype))
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


def _check_content(content: Scene | LightField) -> None:
    if not isinstance(content, LightField):
        _check_scene(content)
        return
    if content.views.ndim != 5 or 0 in content.views.shape:
        raise BrokenPromise(f"views of {content.views.shape}")
    _check_pixels(content.views[0, 0])


def _check_pixels(pixels: Pixels) -> None:
    if pixels.ndim != 3 or pixels.dtype not in (np.uint8, np.uint16) or not 1 <= pixels.shape[2] <= 4:
        raise BrokenPromise(f"pixels {pixels.shape} of {pixels.dtype}")
    if 0 in pixels.shape:
        raise BrokenPromise(f"pixels {pixels.shape}")


def _check_scene(scene: Scene) -> None:
    if not np.isfinite(scene.bounds()).all() or not scene.triangles:
        raise BrokenPromise("a scene without finite bounds, or without triangles")
    if not all(note.isprintable() for note in scene.notes):
        raise BrokenPromise(f"a note that is no line: {scene.notes}")
    for part in scene.parts:
        count = len(part.vertices)
        if not 0 <= part.faces.min() <= part.faces.max() < count or part.colors.shape != (count, 4):
            raise BrokenPromise(f"faces or colours that don't fit {count} vertices")
        if not (np.isfinite(part.colors).all() and part.colors.min() >= 0 and part.colors.max() <= 1):
            raise BrokenPromise("colours outside [0, 1]")
        if part.uv is not None and not np.isfinite(part.uv).all():
            raise BrokenPromise("texture coordinates that are not finite")


def _quilt(data: bytes) -> None:
    """The JSON beside a quilt."""
    files = {"a.png": _EIA, "a.png.json": data}
    _check_content(inputs.read(Bundle("a.png", "a.png", files, LIMITS)))


def _display(data: bytes) -> None:
    """A panel's TOML file; its first and last row are traced."""
    display = parse_display(data, name="d.toml", max_pixels=LIMITS.pixels)
    for row in (0, display.height - 1):
        if not np.isfinite(display.trace_row(row)).all():
            raise BrokenPromise("lines that are not finite")


def _calibration(data: bytes) -> None:
    """A lenticular display's JSON file."""
    calibration = parse_calibration(data, name="c.json", max_pixels=LIMITS.pixels)
    places = calibration.view_places(calibration.height - 1)
    if not (places.min() >= 0 and places.max() <= 1):
        raise BrokenPromise("views outside the cone")


TARGETS: dict[str, Target] = {
    "png": Target(picture("png"), seeds.png),
    "png-sealed": Target(sealed_png, seeds.png),
    "jpeg": Target(picture("jpg"), seeds.jpegs),
    "tiff": Target(picture("tif"), seeds.tiffs),
    "webp": Target(picture("webp"), seeds.webps),
    "lytro": Target(container(SUFFIXES[".lfp"]), containers.lytro),
    "lytro-values": Target(lytro_values, lambda: [bytes([number, 0, 3, 0]) for number in range(2)]),
    "ktx2": Target(picture("ktx2"), gltf_extensions.ktx2),
    "zip": Target(archive, seeds.zips),
    "views": Target(view_set, seeds.view_sets),
    "glb": Target(mesh(SUFFIXES[".glb"]), lambda: [*gltf.glb(), *gltf_extensions.textured()]),
    "gltf": Target(mesh(SUFFIXES[".gltf"], "a.bin", "x.png"), gltf.gltf),
    "gltf-pose": Target(mesh(SUFFIXES[".gltf"], "a.bin", pose=MeshPose(0.5, "0")), gltf_extensions.pose),
    "gltf-values": Target(gltf_values, gltf_extensions.value_edits),
    "meshopt": Target(mesh(SUFFIXES[".glb"]), gltf_extensions.packed),
    "draco": Target(mesh(SUFFIXES[".glb"]), gltf.draco),
    "obj": Target(mesh(SUFFIXES[".obj"], "a.mtl", "x.png"), seeds.obj),
    "ply": Target(mesh(SUFFIXES[".ply"], "x.png"), seeds.ply),
    "stl": Target(mesh(SUFFIXES[".stl"]), seeds.stl),
    "off": Target(mesh(SUFFIXES[".off"]), seeds.off),
    "dae": Target(mesh(SUFFIXES[".dae"], "x.png"), seeds.dae),
    "3mf": Target(mesh(SUFFIXES[".3mf"]), seeds.threemf),
    "npy": Target(container(SUFFIXES[".npy"]), containers.npy),
    "npz": Target(container(SUFFIXES[".npz"]), containers.npz),
    "npz-arrays": Target(npz_arrays, containers.npz_arrays),
    "mat": Target(container(SUFFIXES[".mat"]), containers.mat),
    "tiff-stack": Target(container(SUFFIXES[".tif"]), containers.tiff_stacks),
    "eslf": Target(eslf, containers.eslf),
    "h5": Target(container(SUFFIXES[".h5"]), containers.hdf5),
    "mp4": Target(container(SUFFIXES[".mp4"]), containers.mp4),
    "mkv": Target(container(SUFFIXES[".mkv"]), containers.matroska),
    "gif": Target(container(SUFFIXES[".gif"]), containers.gif),
    "quilt": Target(_quilt, displays.quilts),
    "display": Target(_display, displays.panels),
    "calibration": Target(_calibration, displays.calibrations),
    "any": Target(anything, lambda: [*seeds.off(), *seeds.stl(), *gltf.glb(), *seeds.png(), *seeds.zips()]),
    "inspection": Target(
        inspected, lambda: [*seeds.off(), *gltf.glb(), *seeds.png(), *seeds.repeating(), *seeds.zips()]
    ),
    "options-eia": Target(asked("upload.png", _EIA), seeds.options),
    "options-mesh": Target(asked("upload.off", _OFF), seeds.options),
    "multipart": Target(form, seeds.multipart),
    "display-form": Target(display_form, displays.forms),
    "plane-form": Target(plane_form, focus.planes),
    "disparity-form": Target(disparity_form, focus.disparities),
}
"""Name -> entry point."""
