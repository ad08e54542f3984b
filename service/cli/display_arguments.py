"""Arguments of `ciir convert` for pictures for displays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.displays.devices import DEFAULT, DEVICES
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.writers.pictures import SUFFIXES

if TYPE_CHECKING:
    import argparse

KINDS = {
    "quilt": ("device", "quilt", "aspect", "disparity"),
    "lenticular": ("calibration", "disparity"),
    "panel": ("display", "conversion", "disparity"),
}
"""Kinds of pictures for displays, and the arguments that each takes."""
ARGUMENTS = {
    "device": ("NAME", f"to quilt: the Looking Glass that it is for: {', '.join(DEVICES)} (default {DEFAULT})"),
    "quilt": ("CxR", "to quilt: columns x rows of views, in place of the device's"),
    "aspect": ("NUMBER", "to quilt: width / height of a view as the display shows it, in place of the device's"),
    "calibration": ("FILE", "to lenticular: the display's calibration, the JSON file that it holds"),
    "display": ("FILE", "to panel: the panel and its lenses in millimetres, a TOML file as in docs/displays.md"),
    "conversion": (
        "NAME",
        "to panel: spoc, so that depth is right (orthoscopic); none, as lenses pick up, depth inverted (default spoc)",
    ),
    "disparity": ("PIXELS", "of a light field: the disparity of what is to lie in the display's plane (default 0)"),
}
"""Each with its placeholder and help."""


def find_kind(args: argparse.Namespace) -> str | None:
    """The kind of picture for a display that is asked for, None for another format. Raises `InvalidOption`."""
    given = [name for name in ARGUMENTS if getattr(args, name) is not None]
    kind: str | None = args.to
    if args.to is not None:
        kind = kind if kind in KINDS else None
    elif args.display is not None:
        kind = "panel"
    elif args.calibration is not None:
        kind = "lenticular"
    else:
        is_named = Path(args.out).suffix.lower() in SUFFIXES and parse_name(Path(args.out).name) is not None
        kind = "quilt" if is_named or args.device or args.quilt else None
    known = KINDS[kind] if kind else ()
    for name in given:
        if name not in known:
            kinds = " or ".join(kind for kind, names in KINDS.items() if name in names)
            raise InvalidOption(f"--{name}: this is for --to {kinds}; leave it out or give that")
    return kind
