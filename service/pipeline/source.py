"""The input of a reconstruction: read once, and described for the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.levels import advise_levels
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle, read_file
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose
from ciir.renderer.readers.registry import ARRAY_PICTURE, LYTRO, LYTRO_RAW, MeshFormat, is_picture
from ciir.renderer.readers.view_set.order import ASKED, reorient, take_order
from ciir.renderer.readers.view_set.view_files import ViewFiles
from ciir.renderer.scene import Scene
from ciir.renderer.shading import LIGHT
from ciir.renderer.writers.atomic_write import read_path, replacing
from ciir.service.pipeline.limits import read_limits
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import CountedFiles, Report

if TYPE_CHECKING:
    from os import PathLike

    from numpy.typing import NDArray

    Frame = str | PathLike[str] | NDArray[Any]
    """A white or dark frame: its path or its pixels, `(H, W)` or `(H, W, C)`."""

Source = Bundle | LightField | Scene | str
"""Files, a light field or a mesh in memory, or the name of a scene in `renderer.scenes`."""


Content = Scene | LightField | ViewFiles
"""What is read from a source: a mesh, views in memory, or views that are decoded when they are first used."""

SCENE = "scene:"
"""The prefix of a shipped scene's name, as in `scene:vase`."""


def open_source(text: str) -> Source:
    """Opens `scene:NAME`, or the files at a path. Raises `InputError`."""
    return text.removeprefix(SCENE) if text.startswith(SCENE) else open_bundle(text)


def open_bundle(text: str) -> Bundle:
    """Opens the file, folder or zip at a path, within the limits of the environment. Raises `InputError`."""
    if not text:
        raise InvalidOption("INPUT: '' is not a name; give a file, a folder, or . for this folder")
    return Bundle.from_path(Path(text), read_limits())


def add_frames(source: Source, *, white: Frame | None, dark: Frame | None) -> Source:
    """Adds white and dark frames to the raw lenslet picture `source`, like a zip of them.

    Raises `InputError`.
    """
    given = {name: frame for name, frame in (("white", white), ("dark", dark)) if frame is not None}
    frames = dict(read_frame(name, frame) for name, frame in given.items())
    if not frames:
        return source
    if not isinstance(source, Bundle) or source.main is None or not (is_picture(source.main) or _is_array(source.main)):
        raise InvalidOption(
            f"{', '.join(given)}: frames go with one raw lenslet picture; give the picture as the input, with its "
            "suffix, such as .png"
        )
    return replace(source, main=None, files={source.main: source.files[source.main]} | frames)


def read_frame(name: str, frame: Frame) -> tuple[str, bytes]:
    """Returns the key and the content of a frame for a bundle. An array becomes a PNG."""
    if isinstance(frame, np.ndarray):
        from ciir.renderer.writers.pictures import encode_png

        return f"frames/{name}.png", encode_png(as_light_field(frame, name).views[0, 0])
    path = read_path(frame, name)
    if not is_picture(path.name):
        raise InvalidOption(f"{name}: {path} is not a picture; give one as large as the raw picture, such as a PNG")
    return f"frames/{name}{path.suffix}", read_file(path, read_limits())


def draw_grid_at(source: Source, options: Options, path: str | PathLike[str]) -> Source:
    """Returns the raw lenslet picture `source`, set up to write a PNG with its lens grid drawn over it when it is read.

    Raises `InvalidOption`.
    """
    place = read_path(path, "show_grid")
    if place.suffix.lower() != ".png":
        raise InvalidOption(f"show_grid: {str(path)!r} doesn't end with .png; rename it, as a PNG is written")
    from ciir.renderer.readers.inputs import find_picture

    found = find_picture(source) if isinstance(source, Bundle) else None
    is_raw = found is not None and (found[0] in (LYTRO, LYTRO_RAW) or options.known_grid is not None)
    if not isinstance(source, Bundle) or not is_raw:
        raise InvalidOption("show_grid: this is for a raw lenslet picture; give one, with lens_pitch")

    def keep(drawn: NDArray[np.uint8]) -> None:
        from ciir.renderer.writers.pictures import encode_png

        with replacing(place) as file:
            file.write(encode_png(drawn))

    return replace(source, keep_grid=keep)


def _is_array(name: str) -> bool:
    """Checks whether `name` has the suffix of an array format, which may hold a picture."""
    return Path(name).suffix.lower() in ARRAY_PICTURE.suffixes


class Input:
    """A source, with a count of the files and bytes that were read from it."""

    def __init__(self, source: Source) -> None:
        self._source = source
        if isinstance(source, Bundle):
            self.name, self.limits = source.name, source.limits
            self._files = CountedFiles(source.files)
            self._source = replace(source, files=self._files)
            return
        self.limits = read_limits()
        if isinstance(source, str):
            self.name = f"scene:{source}"
        else:
            self.name = "light field" if isinstance(source, LightField) else "mesh"

    @property
    def bundle(self) -> Bundle | None:
        """The files, counted as they are read; None for an input in memory."""
        return self._source if isinstance(self._source, Bundle) else None

    def read(self, options: Options) -> Scene | LightField:
        """Reads the mesh, or the light field with all its views in memory. Raises `InputError`."""
        content = self.open(options, views="all")
        return content.load() if isinstance(content, ViewFiles) else content

    def open(self, options: Options, views: str, *, is_upscaled: bool = False) -> Content:
        """Opens the mesh, or the light field, from which `views` selects those that will be used.

        `is_upscaled`: whether views are upscaled, in which case the rounding of an elemental image array that is a JPEG
        is partly undone. Raises `InputError`.
        """
        is_raw = options.known_grid is not None
        if is_raw and not isinstance(self._source, Bundle):
            raise InvalidOption(f"lens_pitch: this is for raw lenslet pictures, unlike {self.name}; leave it out")
        if isinstance(self._source, LightField):
            self._check_views(self._source, options)
            field = reorient(take_order(self._source, options.order), make_layout(options))
            return replace(field, is_ordered=field.is_ordered or options.order in ASKED)
        pose = _make_pose(options)
        if not isinstance(self._source, Bundle) and pose != AS_STORED:
            raise InvalidOption(
                f"time, animation, camera: {self.name} holds no animations and no cameras; leave them out"
            )
        if isinstance(self._source, Scene):
            if not np.array_equal(options.placement.light_direction(), LIGHT):
                raise InvalidOption(
                    f"up, rotate, light: {self.name} is in memory, with its light baked in; give a file for them"
                )
            return self._source
        if isinstance(self._source, str):
            from ciir.renderer.scenes import load_scene

            return load_scene(self._source, options.placement)
        from ciir.renderer.readers import inputs

        layout = replace(make_layout(options), restores_jpeg=is_upscaled)
        content = inputs.open_input(self._source, layout, options.placement, pose, views)
        if not isinstance(content, Scene) and not is_raw and inputs.holds_views(self._source, layout):
            self._check_views(content, options)
        return content

    def _check_views(self, light_field: LightField | ViewFiles, options: Options) -> None:
        """Raises `InvalidOption` for an option for meshes and elemental image arrays that has no effect on views."""
        size = light_field.shape[2:4]
        if options.lenses not in (None, size):
            given = f"{options.lenses[0]}x{options.lenses[1]}"
            raise InvalidOption(
                f"lenses: {given} doesn't fit {self.name}, whose views have {size[0]}x{size[1]} pixels; leave it out"
            )
        for option in ("pickup", "arrangement", "crop"):
            if getattr(options, option) not in (getattr(Options, option), "virtual"):  # views are upright as well
                raise InvalidOption(
                    f"{option}: this is for elemental image arrays and {self.name} holds views; leave it out"
                )
        for option in ("pitch", "delta", "parallax"):
            if getattr(options, option) is not None:
                raise InvalidOption(f"{option}: this is for a lens array and {self.name} holds views; leave it out")

    def read_mesh(self, options: Options) -> Scene:
        """Reads the mesh. Raises `InvalidOption` if the source holds pictures."""
        content = self.read(options) if self.holds_mesh() else None
        if not isinstance(content, Scene):
            raise InvalidOption(
                f"{self.name}: holds pictures; give a mesh (`ciir convert` writes the elemental image array of a light "
                "field)"
            )
        return content

    def holds_mesh(self) -> bool:
        """Checks whether this is a mesh. Raises `InputError` if the files are not of a type that is read."""
        if not isinstance(self._source, Bundle):
            return isinstance(self._source, str | Scene)
        from ciir.renderer.readers.inputs import find_main

        found = find_main(self._source)
        return found is not None and isinstance(found[0], MeshFormat)

    def describe(self, content: Content) -> Report:
        """Returns the report's `input`. `kind` is a file type, `views` for a set of pictures, `scene`, or `array`."""
        described: Report = {"name": self.name, "kind": self._kind()}
        if isinstance(self._source, Bundle):
            described |= {"bytes": sum(self._files.sizes.values()), "files": len(self._files.sizes)}
        if isinstance(content, Scene):
            return described | {"triangles": content.triangles, "parts": len(content.parts)}
        pixels_v, pixels_u, rows, cols, channels = content.shape
        return described | {
            "height": rows * pixels_v,
            "width": cols * pixels_u,
            "channels": channels,
            "bits": content.dtype.itemsize * 8,
        }

    def _kind(self) -> str:
        if not isinstance(self._source, Bundle):
            return "array" if isinstance(self._source, LightField) else "scene"
        from ciir.renderer.readers.inputs import find_main

        found = find_main(self._source)
        return "views" if found is None else found[0].extension


def make_layout(options: Options) -> Layout:
    """Returns how views lie in the input, as far as `options` say."""
    return Layout(
        lenses=options.lenses,
        pixels=options.pixels,
        pickup=options.pickup,
        frame=options.frame,
        arrangement=options.arrangement,
        crop=options.crop,
        order=options.order,
        flip=options.flip,
        transpose=options.transpose == "yes",
        depth_sense=None if options.depth_sense == "auto" else options.depth_sense,
        lens_grid=options.known_grid,
    )


def _make_pose(options: Options) -> MeshPose:
    """Returns the pose to show a mesh in.

    Raises `InvalidOption` for several times, and for an animation without a time.
    """
    times = options.time or (None,)
    if len(times) > 1:
        raise InvalidOption(
            f"time: {len(times)} times make a video of one view, with `ciir reconstruct`; give one time for anything "
            "else"
        )
    if options.animation is not None and options.time is None:
        raise InvalidOption(f"animation: {options.animation!r} is shown at a time; give time, too, such as 0")
    if options.camera is not None and options.up != Options.up:
        raise InvalidOption("up, camera: a camera has its own up direction; leave one of them out")
    if options.camera is not None and options.fit == "none":
        raise InvalidOption("fit, camera: what a camera sees is fitted into the centre view; leave one of them out")
    return MeshPose(times[0], options.camera, options.animation)


def as_light_field(picture: Any, name: str = "images") -> LightField:
    """Makes a light field with one view from one picture, `(H, W)` or `(H, W, C)`.

    Raises `InvalidOption` for others, which `name` is for.
    """
    if not isinstance(picture, np.ndarray):
        given = type(picture).__name__
    elif picture.dtype.newbyteorder("=") not in (np.uint8, np.uint16):
        raise InvalidOption(
            f"{name}: {picture.dtype.name} is not accepted; give uint8 or uint16, as in {advise_levels(picture, name)}"
        )
    elif picture.ndim not in (2, 3) or 0 in picture.shape or picture.shape[2:] > (4,):
        given = f"an array of shape {picture.shape}"
    else:
        return LightField(picture.reshape(1, 1, *picture.shape[:2], -1))
    raise InvalidOption(
        f"{name}: {given} is not accepted; give a picture (H, W) or (H, W, C) with 1 to 4 channels, or "
        "ciir.LightField(array) for views"
    )
