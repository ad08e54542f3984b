"""Makes depth planes from any input."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.bit_depth import count_unused_camera_bits
from ciir.errors import InvalidOption, TooLarge
from ciir.renderer.backends.progress import ignore_progress
from ciir.renderer.focus.all_in_focus import focus_everywhere
from ciir.renderer.focus.apertures import read_aperture
from ciir.renderer.focus.occluders import make_planes
from ciir.renderer.focus.planes import check_overlap
from ciir.renderer.writers.stacks import Stack
from ciir.service.pipeline.focus.light_fields import Captured, capture, estimate_view
from ciir.service.pipeline.options import KINDS, Options
from ciir.service.pipeline.report import Clock

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from ciir.service.pipeline.report import Report
    from ciir.service.pipeline.run import Progress
    from ciir.service.pipeline.source import Source


def refocus(
    source: Source,
    options: Options,
    write: Callable[[Stack], Sequence[str]],
    *,
    max_pixels: int | None = None,
    progress: Progress = ignore_progress,
    clock: Clock | None = None,
) -> Report:
    """Passes the planes that `options` ask for to `write`, which returns notes. Returns the report.

    `max_pixels`: the most pixels of all planes together, of all views together, and the most samples of a mesh.
    `progress` counts views, then planes. Raises the same errors as `service.pipeline.run.reconstruct`, and
    `InvalidOption`.
    """
    clock = clock or Clock()
    count = options.count_planes()
    options.check_planes()
    captured = capture(
        source,
        options,
        max_pixels=max_pixels,
        progress=lambda done, total: progress(done, total + count),
        clock=clock,
    )
    work = _Planes(captured, options, clock, progress)
    height, width = captured.light_field.shape[2:4]
    if max_pixels is not None and count * height * width > max_pixels:
        raise TooLarge(
            f"{count} planes of {height}x{width} pixels: {count * height * width:,} are over the limit of "
            f"{max_pixels:,}; ask for fewer planes, a smaller scale or a smaller input"
        )
    stack = work.make_stack()
    with clock.stage("encode"):
        notes = write(stack)
    report = stack.describe()
    report["notes"] += notes
    return report


class _Planes:
    """The planes of one job."""

    def __init__(self, captured: Captured, options: Options, clock: Clock, progress: Progress) -> None:
        self._captured, self._options, self._clock, self._progress = captured, options, clock, progress
        self._weights = read_aperture(options.aperture, captured.light_field.shape[:2], options.aperture_shape)
        first, last, count = options.stack or (options.disparity or 0.0, options.disparity or 0.0, 1)
        is_depth = options.depth is not None or options.stack_of == "depths"
        if options.depth is not None:
            first = last = options.depth
        self._kind = "depths" if is_depth else "disparities"
        self._values = np.linspace(first, last, int(count))
        self._disparities = self._find_disparities() if is_depth else self._values
        check_overlap(self._disparities, max(captured.light_field.shape[2:4]) // captured.scale)

    def _find_disparities(self) -> NDArray[np.float64]:
        """Converts the depths to disparities."""
        depths = self._captured.depths
        if depths is None:
            raise InvalidOption(
                f"depth: the geometry of {self._captured.report['input']['name']} is unknown; give pitch "
                "and delta of its lens array, or camera_pitch, focal_length and sensor in millimetres, or a disparity"
            )
        if depths.is_inverse and self._values.min() <= 0:
            raise InvalidOption(f"depth: {self._values.min():g} mm is not in front of the cameras; give more than 0")
        return depths.to_disparity(self._values)

    def make_stack(self) -> Stack:
        """Makes the stack. Its planes are made when they are read."""
        light_field = self._captured.light_field
        height, width, channels = light_field.shape[2:]
        return Stack(
            names=tuple(self._list_names()),
            kind=self._kind,
            values=tuple(self._values),
            shape=(height, width, channels),
            dtype=light_field.dtype,
            make=self._make,
            describe=self._describe,
            fps=self._options.fps,
            unused=count_unused_camera_bits(light_field.views),
        )

    def _list_names(self) -> Iterator[str]:
        if self._options.all_in_focus == "yes":
            yield "all_in_focus"
            return
        unit = "mm" if self._is_in_millimetres() else ""
        for number, value in enumerate(self._values):
            at = f"d{value:+.3f}" if self._kind == "disparities" else f"z{value:.6g}{unit}"
            yield f"plane_{number:03d}_{at}"

    def _is_in_millimetres(self) -> bool:
        return self._captured.depths is not None and self._captured.depths.is_inverse

    def _make(self, order: Sequence[int]) -> Iterator[NDArray[np.float32]]:
        """Makes planes, given their numbers."""
        views = self._captured.light_field.views
        disparities = self._captured.sign * self._captured.scale * self._disparities[list(order)]
        done = self._captured.count
        with self._clock.stage("focus"):
            if self._options.all_in_focus == "yes":
                found = estimate_view(self._captured, None, self._options.limits)
                planes = iter([focus_everywhere(views, found, self._weights)])
            else:
                planes = make_planes(views, disparities, self._weights, self._options.method, self._options.occluders)
        for number in range(len(order)):
            with self._clock.stage("focus"):
                plane = next(planes)
            self._progress(done + number + 1, done + len(order))
            yield plane

    def _describe(self) -> Report:
        """Returns the report so far."""
        report, options, depths = self._captured.report, self._options, self._captured.depths
        return report | {
            "planes": list(self._describe_planes()),
            "method": options.method,
            "depth_unit": None if depths is None else "mm" if depths.is_inverse else "scene units",
            "options": options.as_dict(KINDS["plane"].options),
            "notes": [*report["notes"], *self._list_notes()],
            "timings_ms": self._clock.timings_ms(),
        }

    def _describe_planes(self) -> Iterator[Report]:
        depths = self._captured.depths
        for name, disparity in zip(self._list_names(), self._disparities, strict=True):
            plane: Report = {"name": name}
            if self._options.all_in_focus == "no":
                plane["disparity"] = float(disparity)
                if depths is not None:
                    depth = float(depths.to_depth(disparity))
                    plane["depth"] = depth if np.isfinite(depth) else None
            yield plane

    def _list_notes(self) -> Iterator[str]:
        if self._captured.scale > 1:
            yield (
                f"disparities are in pixels of the views that were read; planes have {self._captured.scale} pixels for "
                "each of them, along each side"
            )
        described, options = self._captured.report["input"], self._options
        is_lens_array = self._captured.sign < 0 and described["kind"] != "views"
        is_behind = options.place in (None, -1) and options.fit != "none"  # otherwise a mesh may reach in front
        if is_lens_array and self._disparities.max() > 0 and ("triangles" not in described or is_behind):
            if self._kind == "depths":
                yield "depths below 0 lie in front of the lens array; most objects are behind it, over 0"
            else:
                yield "disparities over 0 lie in front of the lens array; most objects are behind it, below 0"
