"""A mesh file and what it refers to, to a scene: the one door through which meshes come in."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.readers.file_types import Kind
from ciir.renderer.readers.meshes import gltf, gltf_scene, obj, off, ply, stl
from ciir.renderer.readers.meshes.texture_files import Resolver
from ciir.renderer.readers.names import shown
from ciir.renderer.surface import Surface, assemble

if TYPE_CHECKING:
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.scene import Scene

FAULTS = (
    ArithmeticError,
    AttributeError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)
"""What reading on raises where a file has another shape than its format's (`binascii.Error`, `UnicodeDecodeError` and
`JSONDecodeError` are ValueErrors, `RecursionError` is a RuntimeError, `KeyError` and `IndexError` are LookupErrors).
"""


def read(bundle: Bundle, kind: Kind) -> Scene:
    """The mesh `bundle.main`, whose content is of `kind`, lit and checked. Its other files are in reach by name.

    What was left out or replaced, a missing texture or triangles without area, is a line in the scene's notes.

    Raises `Unreadable`, `UnsupportedType`, `TooLarge` (where memory runs out, too) or `InvalidGeometry`: whatever else
    of `FAULTS` a file of another shape than its format's brings about becomes `Unreadable`.
    """
    if bundle.main is None:
        raise Unreadable(f"{shown(bundle.name)}: a set of files; say which of them is the mesh")
    name = shown(bundle.name)
    data = bundle.files[bundle.main]
    resolver = Resolver(bundle.files, bundle.main, bundle.limits.pixels)
    max_triangles = bundle.limits.triangles
    try:
        with np.errstate(all="ignore"):  # hostile numbers overflow on the way; what comes of them is checked below
            surfaces = _surfaces(data, kind, name, resolver, max_triangles)
        return assemble(surfaces, name=name, notes=resolver.notes, max_triangles=max_triangles)
    except MemoryError as error:
        raise TooLarge(f"{name}: reading it takes more memory than there is; decimate the mesh") from error
    except FAULTS as error:
        if isinstance(error, InputError):
            raise
        why = shown(f"{type(error).__name__}: {error}")
        raise Unreadable(f"{name}: not a {kind.name} that can be read ({why}); export it again") from error


def _surfaces(data: bytes, kind: Kind, name: str, resolver: Resolver, max_triangles: int) -> list[Surface]:
    if kind in {Kind.GLB, Kind.GLTF}:
        document = gltf.parse(data, name=name, resolver=resolver, max_triangles=max_triangles)
        return gltf_scene.surfaces(document, max_triangles=max_triangles)
    if kind is Kind.OBJ:
        return obj.surfaces(data, name=name, resolver=resolver, max_triangles=max_triangles)
    if kind is Kind.PLY:
        return ply.surfaces(data, name=name, resolver=resolver, max_triangles=max_triangles)
    if kind is Kind.STL:
        return stl.surfaces(data, name=name, max_triangles=max_triangles)
    if kind is Kind.OFF:
        return off.surfaces(data, name=name, max_triangles=max_triangles)
    raise UnsupportedType(f"{name}: {kind.name} is not a mesh")
