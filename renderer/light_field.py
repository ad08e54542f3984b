"""The light field `L[v, u, y, x, c]` and pixel mapping between its views and an elemental image array."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.bit_depth import count_unused_camera_bits, raise_levels
from ciir.errors import InvalidOption
from ciir.renderer.backends.progress import ignore_progress, report_made, report_one
from ciir.renderer.levels import advise_levels, round_levels
from ciir.renderer.views import advise_axes, center_view, check_depth_sense, flip_axes, is_turned, read_index

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from ciir.renderer.backends.progress import Progress
    from ciir.renderer.focus.apertures import Shape
    from ciir.renderer.focus.depth_scale import DepthScale
    from ciir.renderer.focus.disparity import DisparityMap
    from ciir.renderer.focus.model import Model
    from ciir.renderer.focus.occluders import Occluders
    from ciir.renderer.focus.planes import Method
    from ciir.renderer.views import DepthSense, Flip, Pickup, View


@dataclass(frozen=True, eq=False, repr=False)
class LightField:
    """All views of a lens array, `L[v, u, y, x, c]`; v and u count views from the top and the left, y and x pixels.

    - `views`: `(V, U, H, W, C)`, uint8 or uint16; C: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha. Arrays in
      another byte order than the machine's are copied to its own.
    - `notes`: what was found while the light field was read or rendered, one line each.
    - `is_ordered`: whether the order of the views is known to be right, or was checked (`ciir.renderer.view_order`).
    - `depth_sense`: `lenses` if farther content moves further to the left from one view to the next on the right,
      `cameras` if nearer content does.
    - `lens_pitch`: pixels from lens to lens in a raw lenslet picture.
    - `is_jpeg`: whether it was read from a JPEG, part of whose rounding was undone.
    - `pixel_aspect`: width / height that a pixel of a view is shown with; only quilts have others than 1. Slices with
      unequal steps along y and x change it.

    `lf[v, u, y, x]` with slices is a part of it, `numpy.asarray(lf)` its views. Raises `InvalidOption` if `views` is no
    such array, for an unknown depth sense, and for a pixel aspect that is not finite and over 0.
    """

    views: NDArray[np.uint8] | NDArray[np.uint16]
    notes: tuple[str, ...] = ()
    is_ordered: bool = False
    depth_sense: DepthSense = "lenses"
    lens_pitch: float | None = None
    pixel_aspect: float = 1.0
    is_jpeg: bool = False

    def __post_init__(self) -> None:
        views: Any = self.views
        if isinstance(views, np.ndarray) and not views.dtype.isnative:
            views = views.astype(views.dtype.newbyteorder("="))
            object.__setattr__(self, "views", views)
        if not isinstance(views, np.ndarray):
            raise InvalidOption(f"views: {type(views).__name__} is not accepted; give a numpy array of uint8 or uint16")
        if views.dtype not in (np.uint8, np.uint16):
            raise InvalidOption(
                f"views: {views.dtype.name} is not accepted; give uint8 or uint16, as in {advise_levels(views)}"
            )
        if views.ndim != 5 or 0 in views.shape or views.shape[4] > 4:
            raise InvalidOption(
                f"views: an array of shape {views.shape} is not accepted; give (V, U, H, W, C) with 1 to 4 channels"
                + advise_axes(views.shape, "views")
            )
        check_depth_sense(self.depth_sense)
        aspect: Any = self.pixel_aspect
        if not isinstance(aspect, Real) or isinstance(aspect, bool) or not 0 < float(aspect) < math.inf:
            raise InvalidOption(
                f"pixel_aspect: {str(aspect)[:40]!r} is not a width / height of a pixel; give one, such as 0.75"
            )
        object.__setattr__(self, "pixel_aspect", float(aspect))

    def __repr__(self) -> str:
        v, u, rows, cols, channels = self.views.shape
        counted = f", {len(self.notes)} note{'s' * (len(self.notes) > 1)}" if self.notes else ""
        content = f"{rows}x{cols} pixels, {channels} channels, {self.views.dtype}"
        return f"LightField({v}x{u} views of {content}, depth sense {self.depth_sense}{counted})"

    def __getitem__(self, slices: slice | tuple[slice, ...]) -> LightField:
        """Returns the part `lf[v, u, y, x]`, as in `lf[2:7, 2:7]` or `lf[:, :, 100:200, 100:200]`; shares memory.

        Raises `InvalidOption` for anything but one to four slices that go forwards and leave something.
        """
        slices = slices if isinstance(slices, tuple) else (slices,)
        if not 1 <= len(slices) <= 4 or not all(map(_goes_forwards, slices)):
            raise InvalidOption(
                "light field: give one to four slices that go forwards, as in [2:7, 2:7]; view(v, u) takes numbers, "
                "and flip reverses"
            )
        step_y, step_x = ([part.step or 1 for part in slices] + [1] * 4)[2:4]
        return replace(self, views=self.views[slices], pixel_aspect=self.pixel_aspect * (step_x / step_y))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Returns `views` as an array."""
        return np.array(self.views, dtype, copy=copy)

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """`(V, U, H, W, C)`."""
        return self.views.shape

    @property
    def dtype(self) -> np.dtype[np.uint8] | np.dtype[np.uint16]:
        """Data type of the pixels."""
        return self.views.dtype

    def view(self, v: int, u: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Returns view (v, u), `(rows, cols, channels)`, v from the top and u from the left; shares memory.

        Raises `InvalidOption` if there is no such view.
        """
        count_v, count_u = self.views.shape[:2]
        found_v, found_u = read_index(v, count_v), read_index(u, count_u)
        if found_v is None or found_u is None:
            raise InvalidOption(
                f"view: {v},{u} is not there; v goes from 0 to {count_v - 1} and u from 0 to {count_u - 1}"
            )
        view: NDArray[np.uint8] | NDArray[np.uint16] = self.views[found_v, found_u]
        return view

    def flip(self, axes: Flip) -> LightField:
        """Returns the light field with its views in reverse order in `u`, in `v` or in both (`uv`); shares memory.

        Reversing both exchanges the depth senses `lenses` and `cameras`. Reversing only one is for a light field whose
        order is wrong: afterwards content moves along that axis as it does along the other one. If the order was right,
        near content then moves one way across and the opposite way down, as in no real scene. The depth sense is that
        of u, so it changes with `u` and not with `v`. After reversing only one the order counts as unknown. `none`
        changes nothing. Raises `InvalidOption` for other axes.
        """
        views, depth_sense = flip_axes(self.views, axes, self.depth_sense)
        return replace(
            self, views=views, depth_sense=depth_sense, is_ordered=self.is_ordered and axes in ("none", "uv")
        )

    def transpose(self) -> LightField:
        """Returns the light field with rows and columns of views exchanged, for one whose first index is the column;
        shares memory. The pictures stay as they are, and the order counts as unknown.
        """
        return replace(self, views=self.views.swapaxes(0, 1), is_ordered=False)

    def save(
        self,
        path: str | PathLike[str],
        /,
        format: str | None = None,  # noqa: A002
        *,
        progress: Progress | None = None,
        **options: Any,
    ) -> tuple[str, ...]:
        """Writes the light field in a format of `docs/formats.md`, which the name decides if `format` is not given.

        A picture (`.png`, `.tif`, `.jpg`) is the elemental image array, except for a display if the options or a
        quilt's name (`NAME_qs8x6a0.75.png`) ask for that; a name without a suffix is a folder of views. `options` are
        those of `ciir.renderer.writers.options.FormatOptions`. `progress(done, total)` counts views, then the file.

        Returns notes on what the format doesn't hold, or holds in another way. Raises `InvalidOption` if `path` can't
        be written or the format can't hold the light field.
        """
        from ciir.renderer.writers.atomic_write import read_path
        from ciir.renderer.writers.options import FormatOptions
        from ciir.renderer.writers.views import save_light_field

        given = FormatOptions.convert(options)
        return save_light_field(self, read_path(path), format, given, progress or ignore_progress)

    def _repr_png_(self) -> bytes:
        """Returns the centre view as PNG, for Jupyter; levels of a camera with fewer than 16 bits fill the range."""
        from ciir.renderer.writers.pictures import encode_png

        view = self.view(*center_view(*self.views.shape[:2]))
        return encode_png(raise_levels(view, count_unused_camera_bits(self.views)))

    def epi(
        self, *, y: int | None = None, x: int | None = None, v: int | None = None, u: int | None = None
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Returns an epipolar plane image (Bolles, Baker & Marimont 1987); shares memory.

        It is row `y` of the views of row `v`, one below the other from u = 0: `(U, W, C)`; or column `x` of the views
        of column `u`, side by side from v = 0: `(H, V, C)`. The defaults are the centre view's row or column, and the
        middle of a view.

        Raises `InvalidOption` if both a row and a column are given, and for one that does not exist.
        """
        count_v, count_u, rows, cols, _ = self.views.shape
        if (y is not None or v is not None) and (x is not None or u is not None):
            raise InvalidOption("epi: a row and a column are asked for; give y and v, or x and u")
        for name, value, count in (("y", y, rows), ("x", x, cols), ("v", v, count_v), ("u", u, count_u)):
            if value is not None and read_index(value, count) is None:
                raise InvalidOption(f"epi: there is no {name}={value}; give 0 to {count - 1}")
        center_v, center_u = center_view(count_v, count_u)
        if x is None and u is None:
            line: NDArray[np.uint8] | NDArray[np.uint16]
            line = self.views[center_v if v is None else v, :, rows // 2 if y is None else y]
            return line
        line = self.views[:, center_u if u is None else u, :, cols // 2 if x is None else x]
        return line.swapaxes(0, 1)

    def refocus(
        self,
        disparity: float,
        *,
        method: Method = "mapping",
        aperture: float | NDArray[Any] | None = None,
        shape: Shape = "disc",
        occluders: Occluders = "keep",
        rounded: bool = True,
    ) -> NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]:
        """Returns the depth plane of `disparity`, `(H, W, C)`: content with it is sharp, as the middle of the grid sees
        it.

        `disparity`: by how many pixels a point moves to the left from one view to the next on the right;
        `ciir.DepthScale` converts it from a depth. The rest as for `planes`.
        """
        if isinstance(disparity, np.ndarray) and disparity.ndim == 0:
            disparity = disparity.item()
        if isinstance(disparity, np.ndarray | list | tuple):
            raise InvalidOption(
                f"disparity: {type(disparity).__name__} is not one number; give one, such as 0.5, or several to "
                "light_field.planes"
            )
        if not isinstance(disparity, Real) or isinstance(disparity, bool):
            raise InvalidOption(
                f"disparity: {str(disparity)[:40]!r} is not a number; give pixels per view, such as 0.5"
            )
        disparities = [float(disparity)]
        (plane,) = self.planes(
            disparities, method=method, aperture=aperture, shape=shape, occluders=occluders, rounded=rounded
        )
        return plane

    def planes(
        self,
        disparities: Iterable[float] | NDArray[np.floating],
        *,
        method: Method = "mapping",
        aperture: float | NDArray[Any] | None = None,
        shape: Shape = "disc",
        occluders: Occluders = "keep",
        rounded: bool = True,
        progress: Progress | None = None,
    ) -> Iterator[NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]]:
        """Yields the depth plane of each of `disparities`, `(H, W, C)`, one after the other.

        `disparities`: a list, an array or anything else that gives numbers one by one. `method`: `mapping`, `window` or
        `delta`, of `ciir.renderer.focus.planes`. `aperture`: the radius, in views around the middle, of the views that
        count, by default all, or a weight for each view, `(V, U)`. `shape`: `disc`, `square` or `gauss`, of
        `ciir.renderer.focus.apertures`. `occluders`: with `remove`, what stands in front of a plane is removed
        (`ciir.renderer.focus.occluders`), with the method `mapping`. `rounded`: False gives float32 in the units of the
        views, not rounded to them. `progress(done, total)` counts planes, as they are made.

        Raises `InvalidOption` for disparities that are not finite or over the longer side of a view; for an unknown
        method, shape or value of `occluders`; for `occluders` that don't go with the method; and for an aperture
        without views.
        """
        from ciir.renderer.focus.apertures import read_aperture
        from ciir.renderer.focus.occluders import make_planes
        from ciir.renderer.focus.planes import check_overlap, read_disparities

        numbers = read_disparities(disparities)
        weights = read_aperture(aperture, self.views.shape[:2], shape)
        planes = make_planes(self.views, numbers, weights, method, occluders)
        check_overlap(numbers, max(self.views.shape[2:4]))
        planes = report_made(planes, len(numbers), progress or ignore_progress)
        return (round_levels(plane, self.views.dtype) for plane in planes) if rounded else planes

    def all_in_focus(
        self,
        found: DisparityMap | None = None,
        *,
        aperture: float | NDArray[Any] | None = None,
        shape: Shape = "disc",
        progress: Progress | None = None,
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Returns a view with everything sharp and less noise, `(H, W, C)`: made from the views at each pixel's
        disparity.

        `found`: the disparity of the view, by default that of the centre view, which is estimated. `aperture` and
        `shape` as for `planes`. `progress` is called with (0, 1) and (1, 1). Raises `InvalidOption` as `disparity` and
        `planes` do, and for a disparity map of other views.
        """
        from ciir.renderer.focus.all_in_focus import focus_everywhere
        from ciir.renderer.focus.apertures import read_aperture
        from ciir.renderer.focus.disparity import DisparityMap

        weights = read_aperture(aperture, self.views.shape[:2], shape)
        with report_one(progress or ignore_progress):
            found = self.disparity() if found is None else found
            if not isinstance(found, DisparityMap):
                raise InvalidOption(f"found: {type(found).__name__} is not accepted; give what disparity() returns")
            if found.depth_sense != self.depth_sense:
                raise InvalidOption(
                    f"found: a map of views with the depth sense {found.depth_sense}, not {self.depth_sense}; give the "
                    "disparity of this light field"
                )
            self.view(*found.view)
            return round_levels(focus_everywhere(self.views, found, weights), self.views.dtype)

    def disparity(
        self,
        view: View | None = None,
        *,
        limits: tuple[float, float] | None = None,
        progress: Progress | None = None,
    ) -> DisparityMap:
        """Estimates the disparity of each pixel of `view`, by default the centre one, with its confidence.

        `limits`: the smallest and the largest disparity in pixels per view, by default those in the centre and the
        corners. `progress` is called with (0, 1) and (1, 1).

        Raises `InvalidOption` as `ciir.renderer.focus.disparity.estimate_disparity` does.
        """
        from ciir.renderer.focus.disparity import estimate_disparity

        with report_one(progress or ignore_progress):
            return estimate_disparity(self, view, limits=limits)

    def disparities(
        self,
        views: Sequence[View] | None = None,
        *,
        limits: tuple[float, float] | None = None,
        progress: Progress | None = None,
    ) -> Iterator[DisparityMap]:
        """Yields `disparity` of each of `views`, by default of all. `progress(done, total)` counts them."""
        from ciir.renderer.focus.disparity import estimate_disparities

        total = self.views.shape[0] * self.views.shape[1] if views is None else len(views)
        return report_made(estimate_disparities(self, views, limits=limits), total, progress or ignore_progress)

    def model(
        self,
        *,
        pitch: float | None = None,
        delta: float | None = None,
        cameras: DepthScale | None = None,
        keeps_background: bool = False,
        progress: Progress | None = None,
    ) -> Model:
        """Returns the content of the views as coloured triangles, in lens array coordinates; `save` writes GLB and
        PLY.

        `pitch`, `delta`: those of the lens array, if known. `cameras`: for a camera array, `DepthScale.from_cameras`,
        with which depths and widths are true; without it z is in proportion to disparity, with a note. Black or
        transparent pixels that are joined to the border of a view are left out, unless `keeps_background`.
        `ciir.renderer.focus.model` describes the method and the units. `progress(done, total)` counts the views whose
        disparity is estimated.

        Raises `InvalidOption` as `ciir.renderer.focus.model.make_model` does.
        """
        from ciir.renderer.focus.model import make_model

        return make_model(
            self,
            pitch=pitch,
            delta=delta,
            cameras=cameras,
            keeps_background=keeps_background,
            progress=progress or ignore_progress,
        )

    def with_depth_sense(self, sense: DepthSense) -> LightField:
        """Returns the same light field with that depth sense, with views reversed in v and in u if it has the other
        one.

        Raises `InvalidOption` for an unknown one.
        """
        check_depth_sense(sense)
        if sense == self.depth_sense:
            return self
        return replace(self, views=self.views[::-1, ::-1], depth_sense=sense)

    def is_transparent(self) -> bool:
        """Returns whether there is alpha that is not full everywhere. Looks at every pixel."""
        has_alpha = self.views.shape[4] in (2, 4)
        return has_alpha and not (self.views[..., -1] == np.iinfo(self.views.dtype).max).all()

    @classmethod
    def from_eia(
        cls, eia: NDArray[np.uint8] | NDArray[np.uint16], *, rows: int, cols: int, pickup: Pickup = "virtual"
    ) -> LightField:
        """Returns the light field by pixel mapping (Wu et al. 2024, equation 4): view (v, u) is
        `eia[v::pixels_v, u::pixels_u]`.

        `eia`: `(rows*pixels_v, cols*pixels_u, channels)`, or without channels for grey. The views share its memory:
        nothing is copied.

        Raises `InvalidOption` if the lens grid doesn't divide the picture.
        """
        if not isinstance(eia, np.ndarray) or eia.ndim not in (2, 3) or not eia.size:
            given = f"an array of shape {eia.shape}" if isinstance(eia, np.ndarray) else type(eia).__name__
            raise InvalidOption(f"eia: {given} is not accepted; give an array (rows, columns, channels)")
        if not all(isinstance(count, Integral) and not isinstance(count, bool) for count in (rows, cols)):
            raise InvalidOption(
                f"lenses: {rows!r} and {cols!r} are not whole numbers; give the counts of rows and columns"
            )
        height, width = eia.shape[:2]
        if rows < 1 or cols < 1 or height % rows or width % cols:
            raise InvalidOption(
                f"lenses: {rows}x{cols} does not divide the picture of {height}x{width} pixels (rows x columns); "
                "give the lens counts that were used to take it, or crop the picture to whole elemental images"
            )
        blocks = eia.reshape(rows, height // rows, cols, width // cols, -1)  # (y, v, x, u, c)
        if is_turned(pickup):
            blocks = blocks[:, ::-1, :, ::-1]
        return cls(blocks.transpose(1, 3, 0, 2, 4))

    def eia(self, *, pickup: Pickup = "virtual") -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Returns the inverse of `from_eia`, bit for bit: `(rows*pixels_v, cols*pixels_u, channels)`; may share memory.

        The order of views stays: an array for lenses needs `with_depth_sense("lenses")`, which `save` takes care of.
        """
        pixels_v, pixels_u, rows, cols, channels = self.views.shape
        blocks = self.views.transpose(2, 0, 3, 1, 4)  # (y, v, x, u, c)
        if is_turned(pickup):
            blocks = blocks[:, ::-1, :, ::-1]
        if not blocks.flags.c_contiguous:
            copied = np.empty(blocks.shape, blocks.dtype)
            for channel in range(channels):  # four times as fast as all at once
                copied[..., channel] = blocks[..., channel]
            blocks = copied
        return blocks.reshape(rows * pixels_v, cols * pixels_u, channels)


def _goes_forwards(part: Any) -> bool:
    """Returns whether `part` is a slice of whole numbers that doesn't reverse."""
    if not isinstance(part, slice):
        return False
    numbers = [number for number in (part.start, part.stop, part.step) if number is not None]
    return all(isinstance(number, Integral) for number in numbers) and (part.step is None or part.step > 0)
