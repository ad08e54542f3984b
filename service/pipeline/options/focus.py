"""Options of depth planes and disparity maps."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal, get_args

from ciir.errors import InvalidOption
from ciir.renderer.focus.apertures import Shape
from ciir.service.pipeline.options import values
from ciir.service.pipeline.options.option import Option
from ciir.service.pipeline.options.reading import Switch
from ciir.service.pipeline.options.values import (
    ValueType,
    check_number,
    make_form,
    make_name,
    make_number,
    make_switch,
    write_number,
)

Method = Literal["mapping", "window", "delta"]
"""The same as `renderer.focus.planes.Method`, which takes too long to import for the command line."""
Occluders = Literal["keep", "remove"]
"""The same as `renderer.focus.occluders.Occluders`."""
StackKind = Literal["disparities", "depths"]
MOST_PLANES = 1024
ASKED = ("disparity", "depth", "stack", "all_in_focus")
"""Options of which exactly one must be given; it says what to make."""
CAMERAS = ("focal_length", "sensor", "convergence")
"""Options that go with `camera_pitch`."""
_NUMBER = r"-?[0-9]{1,9}(\.[0-9]{1,9})?"


def _make_colons(pattern: str, needed: str, example: str) -> ValueType:
    """Makes a type for numbers separated by colons."""

    def convert(value: Any) -> Any:
        text = made.write(tuple(float(check_number(number)) for number in value))
        if re.fullmatch(pattern, text) is None:
            raise ValueError
        return made.read("", text)

    made = make_form(
        pattern,
        form=f"{needed}, such as {example}",
        parse=lambda _, text: tuple(map(float, text.split(":"))),
        convert=convert,
        needed=f"{needed}, such as ({example.replace(':', ', ')})",
        write=lambda numbers: ":".join(write_number(number, 9) for number in numbers),
    )
    return made


STACK = _make_colons(f"{_NUMBER}:{_NUMBER}:[0-9]{{1,4}}", "FIRST:LAST:COUNT", "-1:1:16")
LIMITS = _make_colons(f"{_NUMBER}:{_NUMBER}", "LEAST:LARGEST", "-2:2")
FOCUS = {
    "depth": Option(
        "DISTANCE",
        "focus on the plane at this distance: behind the lens array, in scene units (for a mesh, or with --pitch and "
        "--delta), or in front of the cameras (with --camera-pitch)",
        make_number(-1e9, 1e9),
        "12.5",
    ),
    "stack": Option(
        "A:B:N",
        "N planes, evenly spaced from A to B: disparities, or depths with --stack-of depths",
        STACK,
        "-1:1:16",
    ),
    "stack_of": Option(
        "NAME",
        "what A and B are: disparities or depths (default disparities)",
        make_name(get_args(StackKind)),
        "depths",
    ),
    "all_in_focus": Option(
        "NAME",
        "yes: the centre view, sharp at every depth, with less noise",
        make_switch(get_args(Switch)),
        "yes",
        "yes",
    ),
    "method": Option(
        "NAME",
        "mapping: pixels are interpolated; window: pictures fade at their borders; delta: convolution with delta "
        "functions, in whole pixels (default mapping)",
        make_name(get_args(Method)),
        "window",
    ),
    "aperture": Option(
        "VIEWS",
        "radius around the middle at which a view counts half, and half a view farther nothing; with gauss all views "
        "count, at the radius by exp(-2) (default: all equally)",
        make_number(0.01, 1e6),
        "2.5",
    ),
    "aperture_shape": Option(
        "NAME", "with --aperture: disc, square or gauss (default disc)", make_name(get_args(Shape)), "gauss"
    ),
    "occluders": Option(
        "NAME",
        "keep: objects in front of a plane blur over it; remove: they are left out (default keep)",
        make_name(get_args(Occluders)),
        "remove",
    ),
    "camera_pitch": Option(
        "MM", "for a camera array: distance between cameras in millimetres", make_number(1e-9, 1e9), "2"
    ),
    "focal_length": Option(
        "MM", "with --camera-pitch: the cameras' focal length in millimetres", make_number(1e-9, 1e9), "35"
    ),
    "sensor": Option(
        "MM", "with --camera-pitch: the width of a camera's sensor in millimetres", make_number(1e-9, 1e9), "36"
    ),
    "convergence": Option(
        "MM",
        "with --camera-pitch: the depth in millimetres at which the pictures were aligned and have no disparity "
        "(default: parallel cameras)",
        make_number(1e-9, 1e9),
        "500",
    ),
    "view": Option(
        "V,U",
        "row and column of the view whose disparity is estimated (default: the centre view)",
        values.VIEW,
        "0,4",
    ),
    "limits": Option(
        "A:B",
        "the smallest and the largest disparity to look for, in pixels of the views that are read (default: found in "
        "the pictures)",
        LIMITS,
        "-2:2",
    ),
    "points": Option(
        "NAME",
        "yes: a 3D model (PLY) is written as points, without triangles",
        make_switch(get_args(Switch)),
        "yes",
        "yes",
    ),
}
"""Options by name, in the order of the help."""


@dataclass(frozen=True)
class FocusOptions:
    """Values of the options in `FOCUS`."""

    depth: float | None = None
    stack: tuple[float, float, float] | None = None
    """The first, the last, and their count, which is a whole number."""
    stack_of: StackKind = "disparities"
    all_in_focus: Switch = "no"
    method: Method = "mapping"
    aperture: float | None = None
    """Views."""
    aperture_shape: Shape = "disc"
    occluders: Occluders = "keep"
    camera_pitch: float | None = None
    """Millimetres, like the next three."""
    focal_length: float | None = None
    sensor: float | None = None
    convergence: float | None = None
    view: tuple[int, int] | None = None
    limits: tuple[float, float] | None = None
    """Pixels."""
    points: Switch = "no"

    def count_planes(self) -> int:
        """Returns the number of planes to make. Raises `InvalidOption` unless exactly one of `ASKED` is given."""
        given = [name for name in ASKED if getattr(self, name) not in (None, "no")]
        if len(given) != 1:
            what = f"{', '.join(given)}: these ask for different pictures" if given else "no plane is asked for"
            raise InvalidOption(f"{what}; give one of disparity, depth, stack and all_in_focus")
        if self.stack is None:
            return 1
        first, last, count = self.stack
        if first == last or not 2 <= count <= MOST_PLANES:
            raise InvalidOption(
                f"stack: {count:g} planes from {first:g} to {last:g} make no stack; give 2 to {MOST_PLANES} planes "
                "between ends that differ, or one disparity or depth"
            )
        return int(count)

    def check_planes(self) -> None:
        """Raises `InvalidOption` if options of planes don't go together."""
        self.count_planes()
        if self.stack is None and self.stack_of != "disparities":
            raise InvalidOption("stack_of: this needs stack; leave it out or give stack")
        if self.aperture is None and self.aperture_shape != "disc":
            raise InvalidOption("aperture_shape: this needs aperture, the radius in views; give both")
        if self.all_in_focus == "yes":
            for name in ("method", "occluders"):
                if getattr(self, name) != getattr(FocusOptions, name):
                    raise InvalidOption(f"{name}: this is for planes; leave it out or give disparity, depth or stack")
        elif self.limits is not None:
            raise InvalidOption(
                "limits: this is for all_in_focus, which looks for disparities; leave it out or give all_in_focus"
            )
        self.check_limits()
        if self.depth is None and self.stack_of != "depths":
            for name in ("camera_pitch", *CAMERAS):
                if getattr(self, name) is not None:
                    raise InvalidOption(f"{name}: this is for depths; give depth, or stack with stack_of depths")
        self.check_cameras()

    def check_limits(self) -> None:
        """Raises `InvalidOption` if `limits` is not a range."""
        if self.limits is not None and self.limits[0] >= self.limits[1]:
            least, largest = self.limits
            raise InvalidOption(f"limits: {least:g}:{largest:g} is not a range; give the smaller disparity first")

    def check_cameras(self) -> None:
        """Raises `InvalidOption` if the geometry of a camera array is incomplete."""
        if self.camera_pitch is None:
            for name in CAMERAS:
                if getattr(self, name) is not None:
                    raise InvalidOption(f"{name}: this needs camera_pitch, focal_length and sensor; give all three")
        elif self.focal_length is None or self.sensor is None:
            raise InvalidOption("camera_pitch: depths need focal_length and sensor too; give all three in millimetres")
