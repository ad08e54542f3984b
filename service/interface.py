"""The Python interface: opens, renders, upscales and reconstructs light fields in memory. `import ciir` exports it."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import numpy as np

from ciir.bit_depth import count_unused_camera_bits, raise_levels
from ciir.errors import InvalidOption, UnsuitedModel
from ciir.models.catalogue import list_entries
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Scene
from ciir.renderer.writers.atomic_write import read_path
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.elemental import render_eia
from ciir.service.pipeline.given import open_given, read_picture
from ciir.service.pipeline.options import RECONSTRUCTION, Options
from ciir.service.pipeline.options.writing import WRITING
from ciir.service.pipeline.run import reconstruct as run_reconstruction
from ciir.service.pipeline.source import Input, add_frames, as_light_field, draw_grid_at

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike
    from typing import Unpack

    from ciir.models.light_field.fusion import Fusion
    from ciir.renderer.placement import Fit, Up
    from ciir.renderer.readers.layout import Arrangement, OrderCheck
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import Flip, Pickup, View
    from ciir.service.pipeline.given import File
    from ciir.service.pipeline.options import Backend, Sampling
    from ciir.service.pipeline.options.lenslet import GridShape, Pitch
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Frame
    from ciir.service.pipeline.typed_options import ReconstructionOptions

    Given = File | LightField

Picture = TypeVar("Picture", np.uint8, np.uint16)


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction:
    """The views of a reconstruction and its report."""

    views: Mapping[View, Pixels]
    """By (v, u), `(H, W, C)`, uint8 or uint16, in the order they were asked for. The frames for several times or yaws
    are keyed by (0, number)."""
    report: Report
    """What was read, the lens array, the plan and its reasons, the model, notes, and the time of each stage."""

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the views with the report.

        One view is written as a picture, several into a `.zip`, an `.npz` or a folder. One view at several times or
        yaws can also be written as a `.mp4`, `.webm`, `.gif` or `.webp`. Raises `InvalidOption` if `path` can't be
        written or its format can't hold the views.
        """
        from ciir.renderer.writers.views import save_views

        array = self.report["lens_array"]
        times = tuple(view.get("time", 0.0) for view in self.report["views"] if "time" in view or "yaw" in view)
        grid = (1, len(times)) if times else (array["pixels_v"], array["pixels_u"])
        save_views(self.views, self.report, read_path(path), grid, array["depth_sense"], times=times)

    def __repr__(self) -> str:
        height, width = next(iter(self.views.values())).shape[:2]
        return (
            f"Reconstruction({len(self.views)} views of {height}x{width} pixels, model {self.report['plan']['model']})"
        )

    def _repr_png_(self) -> bytes:
        """Returns the first view as a PNG, for Jupyter.

        Levels from a camera with fewer than 16 bits are scaled to the full range.
        """
        views = list(self.views.values())
        return encode_png(raise_levels(views[0], count_unused_camera_bits(*views)))


def open(  # noqa: A001 - `ciir.open`, as in Pillow
    path: File,
    *,
    lenses: tuple[int, int] | None = None,
    pixels: tuple[int, int] | None = None,
    pickup: Pickup | None = None,
    frame: int = 0,
    arrangement: Arrangement = "auto",
    crop: tuple[int, int, int, int] = (0, 0, 0, 0),
    order: OrderCheck = "auto",
    flip: Flip = "none",
    transpose: bool = False,
    depth_sense: Literal["auto", "lenses", "cameras"] = "auto",
    lens_pitch: Pitch | None = None,
    lens_offset: tuple[float, float] | None = None,
    lens_rotation: float | None = None,
    lens_grid: GridShape = "auto",
    white: Frame | None = None,
    dark: Frame | None = None,
    show_grid: str | PathLike[str] | None = None,
    progress: Progress | None = None,
) -> LightField:
    """Reads a light field: an elemental image array, a raw lenslet picture, a folder or zip of views, or a container
    from `docs/formats.md` such as `.npz`, `.mat`, `.h5`, a TIFF stack or a video.

    `path`: the file or folder; or its content, as bytes or as a file object opened for reading bytes, whose `name`, if
    it has one, gives the suffix; or an array, which is read like a `.npy` file.
    `lenses`: rows and columns of lenses; `pixels`: rows and columns of pixels under each lens. An elemental image array
    needs one of them. `pickup`: `optical` if each elemental image is turned by 180 degrees, as real lenses do. None
    means what a PNG written by this package says, else `virtual`.
    `frame`: which frame to read from a video of elemental image arrays, which needs `lenses`.
    `crop`: margins in pixels, (top, left, bottom, right). `arrangement`: `eia`; `mosaic` (views side by side, `pixels`
    rows and columns of them, or each of `lenses` pixels); or `auto`, which takes a picture as a mosaic only if it
    certainly is one.
    `order`: `auto` corrects a set of views whose names give a wrong order if that is certain, with a note; `given`
    keeps the order of the names; with `rows` or `columns` the first number in the names is the row or the column; with
    `serpentine` every other row of views, starting with the second, runs from right to left.
    `transpose` swaps rows and columns of views, then `flip` reverses their order in `u`, `v` or `uv`, for files that
    count them from the other end. The depth sense stays, so that `uv` inverts depth. `depth_sense`: `lenses` or
    `cameras`, if the file doesn't say what its views count, or is wrong; their order stays.
    `lens_pitch`: pixels from lens to lens in a raw lenslet picture, or `auto` to find its lens grid in it.
    `lens_offset`: (y, x) of one lens's centre in pixels; `lens_rotation`: the degrees by which rows of lenses go down
    to the right; `lens_grid`: `square` or `hexagonal`. Each of them is found if it is not given. `white`, `dark`: paths
    or arrays of its white and dark frames. `show_grid`: a PNG to write, with the grid drawn over the picture.
    `progress(done, total)` counts inputs: it is called with (0, 1) and (1, 1).

    Raises `ciir.Error`. A mesh is refused with `InvalidOption`; use `render` for it.
    """
    if progress is not None:
        progress(0, 1)
    asked = Options.convert(
        {
            "lenses": lenses,
            "pixels": pixels,
            "pickup": pickup,
            "frame": frame,
            "arrangement": arrangement,
            "crop": crop,
            "order": order,
            "flip": flip,
            "transpose": transpose,
            "depth_sense": depth_sense,
            "lens_pitch": lens_pitch,
            "lens_offset": lens_offset,
            "lens_rotation": lens_rotation,
            "lens_grid": lens_grid,
        }
    )
    source = add_frames(open_given(path), white=white, dark=dark)
    if show_grid is not None:
        source = draw_grid_at(source, asked, show_grid)
    content = Input(source).read(asked)
    if isinstance(content, Scene):
        raise InvalidOption(f"{Input(source).name}: a mesh has no views yet; use ciir.render to make them")
    if progress is not None:
        progress(1, 1)
    return content


def render(
    mesh: File,
    *,
    lenses: tuple[int, int] = (100, 100),
    pixels: tuple[int, int] = (15, 15),
    sampling: Sampling = "pinhole",
    backend: Backend = "auto",
    background: tuple[int, int, int] = (0, 0, 0),
    pitch: float = 1.0,
    delta: float | None = None,
    parallax: float | None = None,
    up: Up = "y",
    rotate: float | tuple[float, float, float] = (0.0, 0.0, 0.0),
    zoom: float = 1.0,
    place: float | None = None,
    depth_factor: float = 1.0,
    fit: Fit = "views",
    light: tuple[float, float] | None = None,
    time: float | None = None,
    animation: str | int | None = None,
    camera: str | int | None = None,
    progress: Progress | None = None,
) -> LightField:
    """Renders all views of a mesh: a file, a folder or zip with one, or `scene:vase`, `scene:globe`, `scene:hamburger`.

    `mesh` can also be the content of a file, as for `open`.

    `lenses`: rows and columns of lenses, which are the pixels of a view; `pixels`: rows and columns under a lens, which
    give the number of views. `sampling`: `pinhole`, one point for each lens; `lenslet`, the mean over the pitch.
    `backend`: `raster` (OpenGL), `raytrace` (Embree) or `auto`. `background`: RGB, 0 to 255. `pitch`: distance between
    lenses in scene units. `delta`: tangent from one pixel to the next, by default 0.4 / the larger number in `pixels`;
    or `parallax`: the whole viewing angle in degrees. `up`: the mesh's axis that points up. `rotate`: yaw, pitch and
    roll in degrees. `zoom`: factor on the size at which every view holds the object. `place`: -1, the default, behind
    the array, 0 centred on it, 1 in front of it. `depth_factor`: factor on its depth, at the same size. `fit`: `none`
    for a mesh in the array's own coordinates, such as a captured model. `light`: azimuth and elevation in degrees.
    `ciir.renderer.placement.Placement` describes the last seven in detail.
    `time`: seconds from the start of a glTF file's animation; `animation`: its name, or its number from 0. `camera`:
    the name, or the number from 0, of a camera in a glTF file; the centre view shows its picture, with parallel rays.
    `progress(done, total)` counts views, or lenses where OpenGL draws by lens.

    Returns `(V, U, H, W, 3)` uint8. Raises `ciir.Error`.
    """
    options = Options.convert(
        {
            "lenses": lenses,
            "pixels": pixels,
            "sampling": sampling,
            "backend": backend,
            "background": background,
            "pitch": pitch,
            "delta": delta,
            "parallax": parallax,
            "up": up,
            "rotate": rotate,
            "zoom": zoom,
            "place": place,
            "depth_factor": depth_factor,
            "fit": fit,
            "light": light,
            "time": time,
            "animation": animation,
            "camera": camera,
        }
    )
    kept: list[Pixels] = []
    counted = ignore_progress if progress is None else progress
    report = render_eia(open_given(mesh), options, kept.append, progress=counted)
    array = report["lens_array"]
    views = LightField.from_eia(kept[0], rows=array["rows"], cols=array["cols"]).views
    return LightField(views, tuple(report["notes"]), is_ordered=True)


@overload
def upscale(
    images: LightField,
    *,
    model: str = ...,
    scale: int = ...,
    fusion: Fusion = ...,
    skip: bool = ...,
    sampling: Sampling = ...,
    progress: Progress | None = ...,
) -> LightField: ...
@overload
def upscale(
    images: np.ndarray[Any, np.dtype[Picture]],
    *,
    model: str = ...,
    scale: int = ...,
    fusion: Fusion = ...,
    skip: bool = ...,
    sampling: Sampling = ...,
    progress: Progress | None = ...,
) -> np.ndarray[Any, np.dtype[Picture]]: ...
@overload
def upscale(
    images: str | PathLike[str],
    *,
    model: str = ...,
    scale: int = ...,
    fusion: Fusion = ...,
    skip: bool = ...,
    sampling: Sampling = ...,
    progress: Progress | None = ...,
) -> Pixels: ...
def upscale(
    images: LightField | np.ndarray[Any, Any] | str | PathLike[str],
    *,
    model: str = "auto",
    scale: int = 2,
    fusion: Fusion = "auto",
    skip: bool = True,
    sampling: Sampling = "pinhole",
    progress: Progress | None = None,
) -> LightField | np.ndarray[Any, Any]:
    """Upscales every view of a light field, or one picture, `(H, W)` or `(H, W, C)`, uint8 or uint16, or its path.

    `model`: a name that `ciir models` lists; `auto` takes a light-field network for a grid of 3x3 views and more, else
    the default single-picture network. `fusion`: which views of a light field become the mean of themselves and their
    upscaled neighbours: `always`, `never`, or `auto` for those of at most 100,000 pixels that look filtered. `skip`:
    whether pixels with a known result are skipped, which changes no pixel. `sampling`: `lenslet` for views that were
    rendered with it, so that means over the lenses stay means. For captured light fields the sampling is detected, and
    so is whether they are free of noise. `progress(done, total)` counts views.

    Returns the same type, or an array for a path, `scale` times as large along each side; with `model` `none` the size
    stays, whatever the scale.
    Raises `ciir.Error`.
    """
    given = read_picture(images, "images") if isinstance(images, str | os.PathLike) else images
    light_field = given if isinstance(given, LightField) else as_light_field(given)
    if light_field is not given and any(entry.name == model and entry.is_light_field for entry in list_entries()):
        raise UnsuitedModel(f"{model} takes the views of a light field, not one picture; give ciir.LightField(array)")
    options = Options.convert(
        {"views": "all", "model": model, "scale": scale, "fusion": fusion, "skip": skip, "sampling": sampling}
    )
    writer = MemoryWriter()
    report = run_reconstruction(light_field, options, writer, progress=progress)
    large: np.ndarray[Any, np.dtype[Any]] = np.stack(list(writer.views.values()))
    if isinstance(given, LightField):
        views = large.reshape(*light_field.views.shape[:2], *large.shape[1:])
        return replace(given, views=views, notes=tuple(report["notes"]), lens_pitch=None, is_jpeg=False)
    return large[0, ..., 0] if given.ndim == 2 else large[0]


def reconstruct(
    source: Given, *, progress: Progress | None = None, **options: Unpack[ReconstructionOptions]
) -> Reconstruction:
    """Runs the main job in memory: makes views of a mesh, an EIA or a set of views, and upscales them.

    `source`: a file, a folder, a zip, `scene:NAME`, a light field, or the content of a file, as for `open`. `options`
    are those of `ciir reconstruct`:
    `lenses`, `pixels`: (rows, columns); `views`: `"center"`, `"cross"`, `"all"` or pairs (v, u); `model`, `strategy`,
    `backend`, `fusion`, `sampling`, `pickup`, `arrangement`, `order`, `flip`, `depth_sense`, `fit`: names;
    `crop`: (top, left, bottom, right); `scale`; `skip`, `transpose`: bools; `background`: RGB from 0 to 255; `pitch`,
    `delta`, `zoom`, `place`, `depth_factor`: numbers; `parallax`, `rotate`, `light`: degrees; `up`: `"y"` or `"z"`;
    `neighbour_time`: seconds; `time`: seconds, or several such as `(0, 0.5, 1)` or `"0:2:48"` for one view at each;
    `animation`, `camera`: a name or a number. Text is parsed as on the command line.
    `progress(done, total)` counts views.

    Raises `ciir.Error`. Options of output files, such as `fps`, are refused, because no file is written.
    """
    names = [name for name in RECONSTRUCTION if name not in WRITING]
    writer = MemoryWriter()
    given = source if isinstance(source, LightField) else open_given(source)
    report = run_reconstruction(given, Options.convert(options, names), writer, progress=progress)
    return Reconstruction(writer.views, report)
