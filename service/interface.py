"""The Python interface: open, render, upscale and reconstruct light fields in memory. `import ciir` shows it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.scene import Scene
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct as run_reconstruction
from ciir.service.pipeline.run import render_eia
from ciir.service.pipeline.source import Input, open_source

if TYPE_CHECKING:
    from collections.abc import Mapping
    from os import PathLike

    from ciir.renderer.light_field import Pickup
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import View
    from ciir.service.pipeline.options import Backend, Sampling
    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress

    Given = str | PathLike[str] | LightField

Picture = TypeVar("Picture", np.uint8, np.uint16)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """The views of a reconstruction and its report."""

    views: Mapping[View, Pixels]
    """By (v, u), `(H, W, C)`, uint8 or uint16, in the order they were asked for."""
    report: Report
    """What was read, the lens array, the plan and its reasons, the model, notes, and the time of each stage."""

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the views: one as a picture, or several into a `.zip`, an `.npz` or a folder, with the report.

        Raises `InvalidOption` where `path` can't be written or its format can't hold the views.
        """
        from ciir.renderer.writers.views import save_views

        save_views(self.views, self.report, Path(path))

    def _repr_png_(self) -> bytes:
        """The first view, for Jupyter."""
        return encode_png(next(iter(self.views.values())))


def open(  # noqa: A001 - `ciir.open`, as in Pillow
    path: str | PathLike[str],
    *,
    lenses: tuple[int, int] | None = None,
    pixels: tuple[int, int] | None = None,
    pickup: Pickup = "virtual",
    progress: Progress | None = None,
) -> LightField:
    """Reads a light field: an elemental image array, or a folder or zip of views.

    `lenses`: rows and columns of lenses; `pixels`: rows and columns of pixels under each. An elemental image array
    needs one of them. `pickup`: `optical` where each elemental image is turned by 180 degrees, as real lenses do.
    `progress(done, total)` counts inputs: it is called with (0, 1) and (1, 1).

    Raises `ciir.Error`; a mesh is refused with `InvalidOption`, since `render` takes it.
    """
    if progress is not None:
        progress(0, 1)
    source = open_source(str(path))
    content = Input(source).read(Options(lenses=lenses, pixels=pixels, pickup=pickup))
    if isinstance(content, Scene):
        raise InvalidOption(f"{path}: a mesh has no views yet; use ciir.render to make them")
    if progress is not None:
        progress(1, 1)
    return content


def render(
    mesh: str | PathLike[str],
    *,
    lenses: tuple[int, int] = (100, 100),
    pixels: tuple[int, int] = (15, 15),
    sampling: Sampling = "pinhole",
    backend: Backend = "auto",
    background: tuple[int, int, int] = (0, 0, 0),
    pitch: float = 1.0,
    delta: float | None = None,
    progress: Progress | None = None,
) -> LightField:
    """Renders all views of a mesh: a file, a folder or zip with one, or `scene:vase`, `scene:globe`, `scene:hamburger`.

    `lenses`: rows and columns, the pixels of a view; `pixels`: rows and columns under a lens, the number of views.
    `sampling`: `pinhole`, one point for each lens; `lenslet`, the mean over the pitch. `backend`: `raster` (OpenGL),
    `raytrace` (Embree) or `auto`. `background`: RGB, 0 to 255. `pitch`: distance between lenses in scene units.
    `delta`: tangent from one pixel to the next, by default 0.4 / the larger count of `pixels`.
    `progress(done, total)` counts light fields: it is called with (0, 1) and (1, 1).

    Returns `(V, U, H, W, 3)` uint8. Raises `ciir.Error`.
    """
    options = Options(
        lenses=lenses,
        pixels=pixels,
        sampling=sampling,
        backend=backend,
        background=background,
        pitch=pitch,
        delta=delta,
    )
    if progress is not None:
        progress(0, 1)
    kept: list[Pixels] = []
    report = render_eia(open_source(str(mesh)), options, kept.append)
    rows, cols = lenses
    views = LightField.from_eia(kept[0], rows=rows, cols=cols).views
    if progress is not None:
        progress(1, 1)
    return LightField(views, tuple(report["notes"]))


@overload
def upscale(
    images: LightField, *, model: str = ..., scale: int = ..., skip: bool = ..., progress: Progress | None = ...
) -> LightField: ...
@overload
def upscale(
    images: np.ndarray[Any, np.dtype[Picture]],
    *,
    model: str = ...,
    scale: int = ...,
    skip: bool = ...,
    progress: Progress | None = ...,
) -> np.ndarray[Any, np.dtype[Picture]]: ...
def upscale(
    images: LightField | np.ndarray[Any, np.dtype[Picture]],
    *,
    model: str = "auto",
    scale: int = 2,
    skip: bool = True,
    progress: Progress | None = None,
) -> LightField | np.ndarray[Any, np.dtype[Picture]]:
    """Upscales every view of a light field, or one picture, `(H, W)` or `(H, W, C)`, uint8 or uint16.

    `model`: a name that `ciir models` lists; `auto` takes a light-field network for a grid of 3x3 views and more, else
    the default of single pictures. `skip`: whether pixels whose result is known are skipped, which changes no pixel.
    `progress(done, total)` counts views.

    Returns the same kind, `scale` times as large along each side. Raises `ciir.Error`.
    """
    light_field = images if isinstance(images, LightField) else as_light_field(images)
    options = Options(views="all", model=model, scale=scale, skip="exact" if skip else "none")
    writer = MemoryWriter()
    report = run_reconstruction(light_field, options, writer, progress=progress)
    large: np.ndarray[Any, np.dtype[Any]] = np.stack(list(writer.views.values()))
    if isinstance(images, LightField):
        return LightField(large.reshape(*light_field.views.shape[:2], *large.shape[1:]), tuple(report["notes"]))
    return large[0, ..., 0] if images.ndim == 2 else large[0]


def reconstruct(source: Given, *, progress: Progress | None = None, **options: Any) -> Reconstruction:
    """Runs the main job in memory: views of a mesh, an elemental image array or a set of views, upscaled.

    `source`: a file, a folder, a zip, `scene:NAME`, or a light field. `options`: the fields of
    `ciir.service.pipeline.options.Options`, which are those of `ciir reconstruct`: `lenses=(50, 50)`, `views="cross"`,
    `model="fast"`, `strategy="auto"`, ... `progress(done, total)` counts views.

    Raises `ciir.Error`.
    """
    writer = MemoryWriter()
    given = source if isinstance(source, LightField) else open_source(str(source))
    try:
        asked = Options(**options)
    except TypeError as error:
        raise InvalidOption(f"{error}; see help(ciir.reconstruct)") from error
    report = run_reconstruction(given, asked, writer, progress=progress)
    return Reconstruction(writer.views, report)


def as_light_field(picture: Pixels) -> LightField:
    """One picture, `(H, W)` or `(H, W, C)`, as a light field of one view. Raises `InvalidOption` for other shapes."""
    shape = getattr(picture, "shape", None)
    if shape is None or len(shape) not in (2, 3):
        given = type(picture).__name__ if shape is None else f"an array of shape {shape}"
        raise InvalidOption(
            f"images: {given} is not taken; give a picture (H, W) or (H, W, C), or ciir.LightField(array) for views"
        )
    return LightField(picture.reshape(1, 1, *shape[:2], -1))
