"""Reads any input as a scene or a light field, by its content."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ciir.errors import InputError, InvalidOption, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.light_field import LightField
from ciir.renderer.placement import AS_GIVEN
from ciir.renderer.readers import meshes, pictures, view_set
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.registry import (
    ContainerFormat,
    Format,
    MeshFormat,
    PictureFormat,
    identify,
    is_container,
    is_mesh,
    is_picture,
)
from ciir.renderer.view_order import correct_order, estimate_order

if TYPE_CHECKING:
    from ciir.renderer.placement import Placement
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.readers.registry import ContainerReader
    from ciir.renderer.scene import Scene


def read(
    bundle: Bundle,
    layout: Layout = Layout(),  # noqa: B008 - it is frozen
    placement: Placement = AS_GIVEN,
) -> Scene | LightField:
    """Reads a mesh as a scene, with the light of `placement`; an elemental image array or views as a light field.

    - One picture: an elemental image array of `layout.lenses` or of elemental images of `layout.pixels`.
    - A file that holds a light field: read by its format's reader.
    - Several files (a folder, a zip): the one mesh among them, or else all pictures as views, in a grid of
      `layout.pixels` where their names don't give one.

    With the order `auto`, views that are certainly in a wrong order are put right, with a note. An elemental image
    array stays as it is: optics give its order.

    Raises `InvalidOption` where an option is missing or doesn't fit; `UnsupportedType`, `Unreadable`, `TooLarge` or
    `InvalidGeometry` for the input.
    """
    found = find_main(bundle)
    if found is None:
        name = clean_text(bundle.name)
        return _settle_order(view_set.read(bundle.files, name=name, grid=layout.pixels, limits=bundle.limits), layout)
    format_, key = found
    if isinstance(format_, MeshFormat):
        return meshes.read(replace(bundle, main=key), format_, placement)
    if isinstance(format_, ContainerFormat):
        return _settle_order(_read_container(bundle, key, format_, layout), layout)
    return replace(_read_eia(bundle, key, layout), is_ordered=layout.order == "given")


def find_main(bundle: Bundle) -> tuple[Format, str] | None:
    """The format and the key of the mesh, picture or container that `read` reads; None for a set of views.

    Raises `UnsupportedType` or `Unreadable` where there is none, or more than one mesh.
    """
    name = clean_text(bundle.name)
    if bundle.main is not None:
        format_ = identify(bundle.name, bundle.files[bundle.main])
        if not isinstance(format_, MeshFormat | PictureFormat | ContainerFormat):
            raise UnsupportedType(f"{name}: {format_.name} holds no mesh and no pictures; give one of them")
        return format_, bundle.main
    names = sorted(bundle.files)
    views = [key for key in names if is_picture(key)]
    found = [key for key in names if is_mesh(key)]
    if len(views) > 1:  # a PLY beside a set of views is a point cloud
        found = [key for key in found if not key.lower().endswith(".ply")]
    if len(found) > 1:
        listed = ", ".join(clean_text(key) for key in found[:3])
        raise Unreadable(
            f"{name}: holds {len(found)} meshes ({listed}{', ...' if found[3:] else ''}); give one of them"
        )
    if found:
        return identify(found[0], bundle.files[found[0]]), found[0]
    containers = [key for key in names if is_container(key)]
    if not views and len(containers) == 1:
        return identify(containers[0], bundle.files[containers[0]]), containers[0]
    if not views:
        raise Unreadable(f"{name}: holds neither a mesh nor pictures; give a mesh, or the views of a light field")
    return None


def _read_container(bundle: Bundle, key: str, format_: ContainerFormat, layout: Layout) -> LightField:
    name = clean_text(bundle.name)
    reader: ContainerReader = format_.load_reader()
    try:
        return reader(bundle.files[key], name=name, layout=layout, limits=bundle.limits)
    except InputError:
        raise
    except MemoryError as error:
        raise TooLarge(f"{name}: reading it takes more memory than there is; give fewer or smaller views") from error
    except Exception as error:
        cause = clean_text(str(error)) or type(error).__name__
        raise Unreadable(f"{name}: the {format_.name} file is truncated or corrupt ({cause}); give it whole") from error


def _settle_order(light_field: LightField, layout: Layout) -> LightField:
    return replace(light_field, is_ordered=True) if layout.order == "given" else _check_order(light_field)


def _check_order(light_field: LightField) -> LightField:
    """The light field with its views in the right order, where theirs is certainly wrong."""
    views, found = light_field.views, estimate_order(light_field.views)
    notes = light_field.notes
    tiles = f"{found.votes} of {found.of} textured tiles"
    if found.is_wrong:
        done = {
            "reversed along one axis": "rows of views are taken from the bottom up",
            "transposed": "the first index is taken as the column",
            "transposed and reversed along one axis": "the first index is taken as the column, counted from the right",
        }[found.order]
        views = correct_order(views, found.order)
        notes += (f"order: {done}, which fits {tiles}; order given keeps the names' order",)
    elif found.is_likely and found.order != "as given":
        notes += (f"order: the views may be {found.order}, as {tiles} show; they are left as they are",)
    return replace(light_field, views=views, notes=notes, is_ordered=True)


def _read_eia(bundle: Bundle, key: str, layout: Layout) -> LightField:
    lenses, pixels = layout.lenses, layout.pixels
    if lenses is None and pixels is None:
        raise InvalidOption(
            f"{clean_text(bundle.name)}: a picture is read as an elemental image array; give the number of lenses, "
            "as in lenses 50x50 (rows x columns), or of pixels of each, as in pixels 15x15"
        )
    eia = pictures.decode(bundle.files[key], name=clean_text(bundle.name), max_pixels=bundle.limits.pixels)
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
    return LightField.from_eia(eia, rows=rows, cols=cols, pickup=layout.pickup)
