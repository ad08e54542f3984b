"""Reads mesh files of every format, with the files that they refer to, as scenes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InputError, InvalidGeometry, InvalidOption, TooLarge, Unreadable
from ciir.renderer.placement import AS_GIVEN
from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose, see_through
from ciir.renderer.readers.meshes.texture_files import Resolver
from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import assemble_scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.placement import Placement
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.readers.registry import MeshFormat
    from ciir.renderer.scene import Scene

UNLIT = "light: all materials of the mesh are unlit, with the light in their colours; leave light out"
UPRIGHT = "up: an STL doesn't say which axis points up, and y is taken; if the object lies down, give up z"
"""The note on files of CAD programs and slicers, most of which have z up."""


def read(
    bundle: Bundle,
    key: str,
    format_: MeshFormat,
    placement: Placement = AS_GIVEN,
    *,
    pose: MeshPose = AS_STORED,
    beside: Sequence[str] = (),
) -> Scene:
    """Reads the mesh in the file `key`, checks it, and lights it for its placement. Its textures are looked up in the
    bundle by name.

    The scene's notes list what was left out or replaced, such as a missing texture or triangles without area, and the
    pictures in `beside` that the mesh doesn't use. An STL with y up and light that changes nothing are noted too.

    Raises `InvalidOption` if the file doesn't have the given `pose`. Raises `Unreadable` (also for any other error of a
    parser), `UnsupportedType`, `TooLarge` (also if memory runs out) or `InvalidGeometry` if the mesh can't be read.
    """
    name = clean_text(bundle.name)
    if pose != AS_STORED and not format_.is_posed:
        raise InvalidOption(
            f"time, animation, camera: these apply only to glTF files, and {name} is {format_.name}; leave them out"
        )
    data = bundle.files[key]
    resolver = Resolver(bundle.files, key, bundle.limits.pixels)
    reader, lens = format_.load_reader(), None
    try:
        with np.errstate(all="ignore"):  # hostile numbers may overflow here; the results are checked below
            if format_.is_posed:
                surfaces, lens = reader(data, name=name, resolver=resolver, limits=bundle.limits, pose=pose)
            else:
                surfaces = reader(data, name=name, resolver=resolver, limits=bundle.limits)
    except (ImportError, InputError):
        raise
    except MemoryError as error:
        raise TooLarge(f"{name}: reading it takes more memory than there is; decimate the mesh") from error
    except Exception as error:
        why = clean_text(f"{type(error).__name__}: {error}")
        raise Unreadable(f"{name}: holds no {format_.name} data that can be read ({why}); export it again") from error
    if format_.name == "STL" and placement.up == "y":
        resolver.add_note(UPRIGHT)
    if placement.light is not None and not any(surface.lit for surface in surfaces):
        resolver.add_note(UNLIT)
    if unused := [other for other in beside if other not in resolver.used]:
        more = f" and {len(unused) - 1} more" if unused[1:] else ""
        resolver.add_note(f"{clean_text(unused[0])}{more} left out: not used by the mesh {clean_text(key)}")
    try:
        scene = assemble_scene(
            surfaces,
            name=name,
            notes=resolver.notes,
            max_triangles=bundle.limits.triangles,
            light=placement.light_direction(),
        )
        return scene if lens is None else see_through(scene, lens, name)
    except InvalidGeometry as error:
        if pose.time is None:
            raise
        raise type(error)(f"{error}, or give another time than {pose.time:g}") from error
    except MemoryError as error:
        raise TooLarge(f"{name}: lighting it takes more memory than there is; decimate the mesh") from error
