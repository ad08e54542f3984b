"""Entry points that read files, each as a function of bytes that checks what it promises (`tests.fuzz.targets`)."""

from __future__ import annotations

import json
import struct
import zlib
from typing import TYPE_CHECKING, get_args

import numpy as np

from ciir.renderer.displays.integral import parse_display
from ciir.renderer.displays.lenticular import parse_calibration
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs, meshes, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet.grid import Known, KnownShape
from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose
from ciir.renderer.readers.png import SIGNATURE
from ciir.renderer.readers.registry import SUFFIXES, Format, identify
from ciir.renderer.writers.pictures import encode_png
from tests.fuzz import seeds
from tests.fuzz.mutate import edit_values
from tests.fuzz.seeds import containers, gltf_extensions, pack, parts

if TYPE_CHECKING:
    from collections.abc import Callable

    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.scene import Scene

LIMITS = Limits(files=64, bytes=2**24, pixels=2**20, set_bytes=2**22, triangles=20_000, views=64)
"""Under the service's own, so that inputs at a limit are found, and cost little."""
EIA = encode_png(seeds.noise(24, 36, 3))


class BrokenPromise(AssertionError):  # noqa: N818 - the cause is the name
    """An entry point broke its promise."""


def picture(suffix: str) -> Callable[[bytes], None]:
    """A picture of a kind by itself."""

    def check(data: bytes) -> None:
        identify(f"upload.{suffix}", data)
        check_pixels(pictures.decode(data, name="upload", max_pixels=LIMITS.pixels))

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
            check_scene(meshes.read(Bundle(name, name, files, LIMITS), name, kind, pose=pose))

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
    check_content(inputs.read(Bundle.from_upload("upload.zip", data, LIMITS), Layout(lenses=(1, 1))))


def anything(data: bytes) -> None:
    """A file without a suffix: its kind follows from its content."""
    check_content(inputs.read(Bundle.from_upload("upload", data, LIMITS), Layout(lenses=(1, 1))))


def container(kind: Format) -> Callable[[bytes], None]:
    """A file that holds a whole light field."""
    name = f"upload.{kind.extension}"
    return lambda data: check_content(inputs.read(Bundle.from_upload(name, data, LIMITS), Layout()))


def npz_arrays(data: bytes) -> None:
    """An npz of arrays: their names, one a line, and the arrays; its checksums are right."""
    listed, *contents = parts(data)
    names = [name for name in listed.decode("latin-1").split("\n") if name]
    container(SUFFIXES[".npz"])(seeds.zipped(dict(zip(names, contents, strict=False))))


def eslf(data: bytes) -> None:
    """A picture that is called as Lytro's."""
    check_content(inputs.read(Bundle.from_upload("upload_eslf.png", seal_png(data), LIMITS), Layout()))


def lenslet(data: bytes) -> None:
    """A raw lenslet picture: seven bytes for its size and the given part of its grid, 0 for none, then its pixels."""
    height, width, pitch, y, x, rotation, shape = data[:7].ljust(7, b"\0")
    known = Known(
        4.5 + pitch / 2 if pitch else None,
        (y / 2, x / 2) if y else None,
        (rotation - 128) / 3 if rotation else None,
        (None, *get_args(KnownShape))[shape % 4],
    )
    picture = np.resize(np.frombuffer(data[7:] or b"\0", np.uint8), (height + 1, width + 1, 3 if shape & 128 else 1))
    bundle = Bundle.from_upload("upload.png", encode_png(picture), LIMITS)
    check_content(inputs.read(bundle, Layout(lens_grid=known)))


def view_set(data: bytes) -> None:
    """A set of views: their names, one a line, and their pictures."""
    listed, *contents = parts(data)
    names = listed.decode("latin-1").split("\n")
    check_content(inputs.read(Bundle("upload.zip", None, dict(zip(names, contents, strict=False)), LIMITS)))


def check_content(content: Scene | LightField) -> None:
    """Views, or a scene, as readers promise them."""
    if not isinstance(content, LightField):
        check_scene(content)
        return
    if content.views.ndim != 5 or 0 in content.views.shape:
        raise BrokenPromise(f"views of {content.views.shape}")
    check_pixels(content.views[0, 0])


def check_pixels(pixels: Pixels) -> None:
    """A picture as readers promise it."""
    if pixels.ndim != 3 or pixels.dtype not in (np.uint8, np.uint16) or not 1 <= pixels.shape[2] <= 4:
        raise BrokenPromise(f"pixels {pixels.shape} of {pixels.dtype}")
    if 0 in pixels.shape:
        raise BrokenPromise(f"pixels {pixels.shape}")


def check_scene(scene: Scene) -> None:
    """A mesh as readers promise it."""
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


def quilt(data: bytes) -> None:
    """The JSON beside a quilt."""
    files = {"a.png": EIA, "a.png.json": data}
    check_content(inputs.read(Bundle("a.png", "a.png", files, LIMITS)))


def display(data: bytes) -> None:
    """A panel's TOML file; its first and last row are traced."""
    parsed = parse_display(data, name="d.toml", max_pixels=LIMITS.pixels)
    for row in (0, parsed.height - 1):
        if not np.isfinite(parsed.trace_row(row)).all():
            raise BrokenPromise("lines that are not finite")


def calibration(data: bytes) -> None:
    """A lenticular display's JSON file."""
    parsed = parse_calibration(data, name="c.json", max_pixels=LIMITS.pixels)
    places = parsed.view_places(parsed.height - 1)
    if not (places.min() >= 0 and places.max() <= 1):
        raise BrokenPromise("views outside the cone")
