"""What was given, to a scene or a light field: by what it is, not by what anyone says that it is."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField, Pickup
from ciir.renderer.readers import meshes, pictures, view_set
from ciir.renderer.readers.bundle import is_kind
from ciir.renderer.readers.file_types import MESHES, PICTURES, Kind, claimed, identify
from ciir.renderer.readers.names import shown

if TYPE_CHECKING:
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.scene import Scene


def read(
    bundle: Bundle, *, lenses: tuple[int, int] | None, pixels: tuple[int, int] | None, pickup: Pickup = "virtual"
) -> Scene | LightField:
    """A mesh as a scene; an elemental image array, or a set of views, as a light field.

    - A mesh: `lenses` and `pixels` play no part, they say how it is rendered.
    - One picture: an elemental image array of `lenses` (rows, columns); with `pixels` (v, u) alone, of as many lenses
      as go into it. Both must agree with its size.
    - Several files (a folder, a zip): the one mesh among them, or else all pictures as views, of which there are
      `pixels` (v, u) where their names don't tell.

    Raises `InvalidOption` where an option is missing or doesn't fit; `UnsupportedType`, `Unreadable`, `TooLarge` or
    `InvalidGeometry` where the input is at fault.
    """
    found = chosen(bundle)
    if found is None:
        return view_set.read(bundle.files, name=shown(bundle.name), grid=pixels, limits=bundle.limits)
    kind, key = found
    if kind in MESHES:
        return meshes.read(replace(bundle, main=key), kind)
    return _eia(bundle, key, lenses, pixels, pickup)


def chosen(bundle: Bundle) -> tuple[Kind, str] | None:
    """What `read` reads of the bundle: the kind and the key of its mesh or its picture; None for a set of views.

    Raises `UnsupportedType` or `Unreadable` where there is none, or more than one mesh.
    """
    name = shown(bundle.name)
    if bundle.main is not None:
        kind = identify(bundle.name, bundle.files[bundle.main])
        if kind not in MESHES | PICTURES:
            raise UnsupportedType(f"{name}: {kind.name} is neither a mesh nor a picture; give one of them")
        return kind, bundle.main
    names = sorted(bundle.files)
    views = [key for key in names if is_kind(key, PICTURES)]
    found = [key for key in names if is_kind(key, MESHES)]
    if len(views) > 1:  # sets of views come with a point cloud beside them, which wants no textures
        found = [key for key in found if claimed(key) is not Kind.PLY]
    if len(found) > 1:
        listed = ", ".join(shown(key) for key in found[:3])
        raise Unreadable(
            f"{name}: holds {len(found)} meshes ({listed}{', ...' if found[3:] else ''}); give one of them"
        )
    if found:
        return identify(found[0], bundle.files[found[0]]), found[0]
    if not views:
        raise Unreadable(f"{name}: holds neither a mesh nor pictures; give a mesh, or the views of a light field")
    return None


def _eia(
    bundle: Bundle, key: str, lenses: tuple[int, int] | None, pixels: tuple[int, int] | None, pickup: Pickup
) -> LightField:
    if lenses is None and pixels is None:
        raise InvalidOption(
            f"{shown(bundle.name)}: a picture is read as an elemental image array; say how many lenses took it, "
            "as in lenses 50x50 (rows x columns), or how many pixels each has, as in pixels 15x15"
        )
    eia = pictures.decode(bundle.files[key], name=shown(bundle.name), max_pixels=bundle.limits.pixels)
    height, width = eia.shape[:2]
    if pixels is not None and (min(pixels) < 1 or height % pixels[0] or width % pixels[1]):
        raise InvalidOption(
            f"pixels: {pixels[0]}x{pixels[1]} does not divide the picture of {height}x{width} pixels (rows x columns); "
            "give the size of one elemental image, or crop the picture to whole ones"
        )
    counted = None if pixels is None else (height // pixels[0], width // pixels[1])
    rows, cols = lenses or counted or (0, 0)
    if pixels is not None and counted != (rows, cols):
        raise InvalidOption(
            f"lenses, pixels: {rows}x{cols} lenses of {pixels[0]}x{pixels[1]} pixels do not make the picture of "
            f"{height}x{width} pixels; give one of the two options alone"
        )
    return LightField.from_eia(eia, rows=rows, cols=cols, pickup=pickup)
