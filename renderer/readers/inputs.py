"""Reads any input as a scene or a light field, according to its content."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption, Unreadable, UnsupportedType
from ciir.renderer.placement import AS_GIVEN
from ciir.renderer.readers import meshes
from ciir.renderer.readers.containers import quilts
from ciir.renderer.readers.eia import reader as eia
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.lenslet.grid import Known
from ciir.renderer.readers.meshes.pose import AS_STORED, MeshPose
from ciir.renderer.readers.names import FRAMES, TILES, clean_text
from ciir.renderer.readers.registry import (
    ARRAY_PICTURE,
    ARRAYS,
    ESLF,
    LYTRO,
    LYTRO_RAW,
    OTHER_MESHES,
    TIFF_STACK,
    VIDEOS,
    ContainerFormat,
    Format,
    MeshFormat,
    PictureFormat,
    find_by_suffix,
    identify,
    is_container,
    is_mesh,
    is_picture,
    reported,
)
from ciir.renderer.readers.view_set import reader as view_set
from ciir.renderer.readers.view_set.order import reorient, settle_order
from ciir.renderer.readers.view_set.view_files import ViewFiles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ciir.renderer.displays.quilt import QuiltLayout, QuiltName
    from ciir.renderer.light_field import LightField
    from ciir.renderer.placement import Placement
    from ciir.renderer.readers.bundle import Bundle
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.readers.registry import ContainerReader
    from ciir.renderer.scene import Scene


def read(
    bundle: Bundle,
    layout: Layout = Layout(),  # noqa: B008 - it is frozen
    placement: Placement = AS_GIVEN,
) -> Scene | LightField:
    """Reads an input as `open_input` does, with all views in memory."""
    content = open_input(bundle, layout, placement)
    return content.load() if isinstance(content, ViewFiles) else content


def open_input(
    bundle: Bundle,
    layout: Layout,
    placement: Placement = AS_GIVEN,
    pose: MeshPose = AS_STORED,
    views: str = "all",
) -> Scene | LightField | ViewFiles:
    """Reads a mesh as a scene, with the light of `placement`; an elemental image array or views as a light field.

    - A picture that is a quilt by its name, or by the JSON next to it, is read as one. From a video of quilts the frame
      `layout.frame` is read.
    - Any other picture is an elemental image array of `layout.lenses`, or of elemental images of `layout.pixels`. With
      `layout.lens_grid`, or from a Lytro camera, it is a raw lenslet picture; in a folder or a zip it may come with its
      frames, pictures named white and dark.
    - A file that contains a light field is read by its format's reader.
    - If there are several files (a folder, a zip), the one mesh among them is read, or else all pictures as views, in a
      grid of `layout.pixels` if their names don't give one. Views are decoded when they are first used; `views` selects
      those that will be (`renderer.views.parse_views`).

    Views are put in the order that `layout` specifies. If it specifies none, views that are certainly in a wrong order
    are corrected, with a note. An elemental image array stays as it is, because its order comes from the optics; a note
    names the options that would correct it. `pose` selects what is shown of a mesh with animations or cameras.

    Raises `InvalidOption` if an option is missing or doesn't fit, and `UnsupportedType`, `Unreadable`, `TooLarge` or
    `InvalidGeometry` for the input.
    """
    found = find_main(bundle)
    name = clean_text(bundle.name)
    if layout.frame and not (
        found is not None
        and found[0].name in VIDEOS
        and (layout.selects_frame or _find_quilt(bundle, found[1], layout) is not None)
    ):
        raise InvalidOption(
            "frame: this is for a video of elemental image arrays (with lenses or arrangement eia) or of quilts "
            f"(NAME_qs8x6a0.75.mp4); leave it out for {name}"
        )
    if layout.lens_grid is None and found is not None and found[0] in (LYTRO, LYTRO_RAW):
        layout = replace(layout, lens_grid=Known())
    if layout.lens_grid is not None:
        picture = find_picture(bundle)
        if picture is None:
            raise InvalidOption(f"lens_pitch: this is for one raw lenslet picture, and {name} is not one; leave it out")
        from ciir.renderer.readers.lenslet import reader

        raw = reader.read(bundle, picture[1], layout, layout.lens_grid)
        return _note_left_out(settle_order(raw, layout, corrects=False), bundle, picture[1])
    if found is None:
        return view_set.read(bundle.files, name=name, layout=layout, limits=bundle.limits, views=views)
    format_, key = found
    if isinstance(format_, MeshFormat):
        holds_others = bundle.main is None and format_.is_one_file
        beside = sorted(filter(is_picture, bundle.files)) if holds_others else ()
        return meshes.read(bundle, key, format_, placement, pose=pose, beside=beside)
    return _note_left_out(_read_file(bundle, _refine(format_, key, bundle, layout), key, layout), bundle, key)


def _read_file(bundle: Bundle, format_: Format, key: str, layout: Layout) -> LightField:
    """Reads the light field in a container or a picture."""
    if isinstance(format_, ContainerFormat):
        if format_.name in VIDEOS and (quilt := _find_quilt(bundle, key, layout)) is not None:
            return reorient(_read_quilt_frame(bundle, key, format_, quilt, layout.frame), layout)
        light_field = _read_container(bundle, key, format_, layout)
        is_array = format_.name in VIDEOS and light_field.depth_sense == "lenses"
        return settle_order(light_field, layout, corrects=not is_array)
    layout = eia.complete_layout(layout, bundle.files[key])
    if bundle.find_frames(key):
        raise InvalidOption(
            f"lens_pitch: {clean_text(bundle.name)} holds a picture with white or dark frames, as raw lenslet "
            "pictures have; give their pitch in pixels, or auto"
        )
    if format_ is ARRAY_PICTURE:
        picture, notes = read_array_picture(bundle, key)
        found = eia.read_pixels(picture, name=_name_main(bundle, key), layout=layout)
        found = replace(found, notes=(*found.notes, *notes))
    elif (quilt := _find_quilt(bundle, key, layout)) is not None:
        return reorient(quilts.read(bundle, key, quilt), layout)
    else:
        found = eia.read(bundle.files[key], name=_name_main(bundle, key), layout=layout, limits=bundle.limits)
    light_field = _find_eslf(found, layout)
    return settle_order(light_field, layout, corrects=light_field.depth_sense == "cameras")  # no EIA


def read_array_picture(bundle: Bundle, key: str) -> tuple[Pixels, tuple[str, ...]]:
    """Reads the pixels `(H, W, C)` of a picture that is stored as an array, and notes. Raises `InputError`."""
    from ciir.renderer.readers.containers import array_pictures

    name = _name_main(bundle, key)
    with reported(name, ARRAY_PICTURE):
        return array_pictures.read(bundle.files[key], name, bundle.limits)


def _note_left_out(light_field: LightField, bundle: Bundle, key: str) -> LightField:
    """Adds a note on other files of a folder or a zip that may have been meant instead of `key`, which was read."""
    if bundle.main is not None:
        return light_field
    known = {key, *bundle.find_frames(key).values()}
    others = [other for other in sorted(bundle.files) if other not in known and not view_set.is_side_file(other)]
    if not others:
        return light_field
    more = f" and {len(others) - 1} more" if others[1:] else ""
    note = f"{clean_text(others[0])}{more} left out: {clean_text(key)} holds the light field"
    return replace(light_field, notes=(*light_field.notes, note))


def _find_eslf(light_field: LightField, layout: Layout) -> LightField:
    """Selects the views that are not empty, with a note, if an elemental image array is ESLF under another name."""
    from ciir.renderer.readers.containers import eslf

    is_open = (layout.arrangement, light_field.depth_sense) == ("auto", "lenses") and layout.pickup != "optical"
    if not (is_open and eslf.has_empty_corners(light_field.views)):
        return light_field
    found = eslf.select_views(light_field.views)
    return replace(found, notes=(*found.notes, eslf.RECOGNISED))


def holds_views(bundle: Bundle, layout: Layout) -> bool:
    """Checks whether `open_input` reads `bundle`, which is not a raw lenslet picture, as views."""
    found = find_content(bundle, layout)
    if found is None:
        return True
    format_, key = found
    if isinstance(format_, ContainerFormat):
        return format_.name not in VIDEOS or not layout.selects_frame
    is_file = isinstance(format_, PictureFormat) and format_ is not ARRAY_PICTURE
    return is_file and _find_quilt(bundle, key, layout) is not None


def find_content(bundle: Bundle, layout: Layout) -> tuple[Format, str] | None:
    """Finds the main file as `find_main` does, but the content decides if its format leaves that open: an array may be
    a picture, and a picture a container.
    """
    found = find_main(bundle)
    return None if found is None else (_refine(*found, bundle, layout), found[1])


def find_picture(bundle: Bundle) -> tuple[PictureFormat, str] | None:
    """Finds the main file if it is a picture, or an array with one, that may be a raw lenslet picture; else None."""
    found = find_main(bundle)
    if found is None:
        return None
    format_ = _refine(*found, bundle, Layout()) if found[0].name in ARRAYS else found[0]
    return (format_, found[1]) if isinstance(format_, PictureFormat) else None


def find_main(bundle: Bundle) -> tuple[Format, str] | None:
    """Returns the format and the key of the mesh, picture or container that `read` reads, or None for a set of views.

    Of several files this is the one mesh, or else the one container next to at most one picture, or else the picture
    that is alone or has frames. A picture that is named like the views that we write is a set of one view.

    Raises `UnsupportedType` or `Unreadable` if there is none, or more than one mesh or container, and `UnsupportedType`
    if the one mesh is of a type that isn't read.
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
    if len(views) > 1:  # a PLY next to a set of views is a point cloud
        found = [key for key in found if not key.lower().endswith(".ply")]
    if len(found) > 1:
        raise Unreadable(
            f"{name}: holds {len(found)} meshes ({_list_some(found)}); give one of them, or a folder of them to `ciir "
            "batch`, which reconstructs each"
        )
    if found:
        return identify(found[0], bundle.files[found[0]]), found[0]
    _refuse_textures(name, names, views)
    if {*TILES} <= {PurePosixPath(key).name for key in names}:
        raise UnsupportedType(
            f"{name}: tiles are written for viewers and can't be read; write the light field as npz, or as another "
            "container, too"
        )
    pictures = [key for key in views if len(views) == 1 or PurePosixPath(key).stem.lower() not in FRAMES]
    containers = [key for key in names if is_container(key)] if len(pictures) <= 1 else []
    if len(containers) > 1:
        raise Unreadable(
            f"{name}: holds {len(containers)} files that may be light fields ({_list_some(containers)}); give one of "
            "them"
        )
    if containers:
        return identify(containers[0], bundle.files[containers[0]]), containers[0]
    _refuse_meshes(name, names, has_pictures=bool(views))
    if len(pictures) == 1 and view_set.OWN_NAME.fullmatch(PurePosixPath(pictures[0]).name) is None:
        return identify(pictures[0], bundle.files[pictures[0]]), pictures[0]
    if not views:
        raise Unreadable(
            f"{name}: {_describe_others(names)}; give a mesh, or the views of a light field as .png, .jpg or .tif files"
        )
    return None


def _refuse_textures(name: str, names: Sequence[str], pictures: Sequence[str]) -> None:
    """Raises `UnsupportedType` if all `pictures` are in a folder `textures` and there is a zip in a folder `source`:
    Sketchfab packs meshes like this.
    """
    if not pictures or not all(_lies_in("textures", key) for key in pictures):
        return
    for key in filter(partial(_lies_in, "source"), names):
        if key.lower().endswith(".zip"):
            raise UnsupportedType(
                f"{name}: the mesh seems to be in a zip, {clean_text(key)}, which is not unpacked within a folder or "
                "another zip; unpack all into one folder and give that"
            )


def _refuse_meshes(name: str, names: Sequence[str], *, has_pictures: bool) -> None:
    """Raises `UnsupportedType` if there is a mesh of a type that isn't read: pictures next to it are its textures."""
    for key in names:
        if PurePosixPath(key).suffix.lower() in OTHER_MESHES:
            try:
                find_by_suffix(f"{name}/{key}")
            except UnsupportedType as error:
                more = "; if the pictures are the light field, give them without it" if has_pictures else ""
                raise UnsupportedType(f"{error}{more}") from error


def _lies_in(folder: str, key: str) -> bool:
    return PurePosixPath(key).parent.name.lower() == folder


def _list_some(keys: Sequence[str]) -> str:
    return ", ".join(clean_text(key) for key in keys[:3]) + (", ..." if keys[3:] else "")


def _name_main(bundle: Bundle, key: str) -> str:
    """Returns the main file's name for messages, after the name of the folder or zip if that may hold other files."""
    return clean_text(bundle.name if bundle.main is not None else f"{bundle.name}/{key}")


def _find_quilt(bundle: Bundle, key: str, layout: Layout) -> QuiltLayout | QuiltName | None:
    """Returns the layout of a quilt, or None for another picture. Raises `InvalidOption` if other numbers are given."""
    given = "lenses" if layout.lenses else "pixels" if layout.pixels else None
    if given is not None and layout.arrangement != "auto":
        return None
    found = quilts.find_layout(bundle, key)
    if found is not None and given is not None:
        raise InvalidOption(
            f"{given}: {clean_text(bundle.name)} is a quilt of {found.cols}x{found.rows} views (columns x rows), as "
            "its name or the JSON next to it says; leave it out, or give arrangement eia or mosaic for another picture"
        )
    return found


def _refine(format_: Format, key: str, bundle: Bundle, layout: Layout) -> Format:
    """Returns the container's format for a picture that is a container, the picture's format for an array that is a
    picture, and otherwise `format_`.
    """
    if format_.name == "TIFF":
        from ciir.renderer.readers.containers import tiff_stack

        return TIFF_STACK if tiff_stack.is_stack(bundle.files[key]) else format_
    if format_.name in ARRAYS:
        from ciir.renderer.readers.containers import array_pictures

        name = _name_main(bundle, key)
        with reported(name, format_):
            is_one = array_pictures.is_picture(bundle.files[key], name, bundle.limits)
        return ARRAY_PICTURE if is_one else format_
    if format_.name == "PNG":
        layout = eia.complete_layout(layout, bundle.files[key])
    if format_.name == "PNG" and layout.lenses is None and layout.arrangement == "auto" and not any(layout.crop):
        from ciir.renderer.readers.containers import eslf

        return ESLF if eslf.is_eslf(key, bundle.files[key]) else format_
    return format_


def _describe_others(names: list[str]) -> str:
    """Describes what a set without a mesh, a picture or a container contains."""
    if not names:
        return "no files in it (hidden files and links to nothing are not read)"
    packed = [name for name in names if name.lower().endswith(".zip")]
    if packed:
        return f"holds a zip, {clean_text(packed[0])}, which is not unpacked within a folder or another zip"
    kinds = sorted({PurePosixPath(name).suffix.lower() or clean_text(name) for name in names})
    listed = ", ".join(clean_text(kind) for kind in kinds[:5]) + (", ..." if kinds[5:] else "")
    return f"none of its {len(names)} files is of a type that is read ({listed})"


def _read_quilt_frame(
    bundle: Bundle, key: str, format_: ContainerFormat, quilt: QuiltLayout | QuiltName, number: int
) -> LightField:
    """Reads the light field in the frame `number` of a video of quilts."""
    from ciir.renderer.readers.containers import video

    name = _name_main(bundle, key)
    with reported(name, format_):
        frame = video.read_frame(bundle.files[key], number, name=name, limits=bundle.limits)
    found = quilts.read_pixels(frame, quilt, name=name)
    note = f"frame {number} is read as a quilt, as the video's name or the JSON next to it says; frame selects another"
    return replace(found, notes=(note, *found.notes))


def _read_container(bundle: Bundle, key: str, format_: ContainerFormat, layout: Layout) -> LightField:
    name = _name_main(bundle, key)
    reader: ContainerReader = format_.load_reader()
    with reported(name, format_):
        light_field = reader(bundle.files[key], name=name, layout=layout, limits=bundle.limits)
    grid = light_field.views.shape[:2]
    if format_ is not ESLF and not {layout.pixels, layout.sequence} & {None, grid}:  # ESLF's pixels are under a lens
        raise InvalidOption(f"pixels: {name} has {grid[0]}x{grid[1]} views; leave it out")
    height, width = light_field.views.shape[2:4]
    is_other = format_ is not ESLF and format_.name not in (*VIDEOS, *ARRAYS)  # arrays get their own note
    if is_other and grid[0] > height and grid[1] > width:
        note = (
            f"axes: {grid[0]}x{grid[1]} views of {height}x{width} pixels; if these are {height}x{width} views of "
            f"{grid[0]}x{grid[1]} pixels, save the array with the axes (V, U, H, W, C)"
        )
        light_field = replace(light_field, notes=(*light_field.notes, note))
    return light_field
