"""Formats the errors and notes of the command line."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from ciir.service.errors import join_lines
from ciir.service.pipeline.options import OPTIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

_NAMES = "|".join(name for name in (*OPTIONS, "show_grid") if "_" in name)
_OPTION = re.compile(rf"""(?<![\w./\\'"-])(?:{_NAMES})(?![\w/\\'"-]|\.\w)""")
"""The name of an option as a word of a sentence: not a part of a path, and not a quoted value."""


def format_message(text: str, given: Sequence[str] = ()) -> str:
    """Formats a message as one line, with options as they are typed: `--lens-pitch` for the `lens_pitch` of JSON.

    Names that are words of `given`, such as the arguments of the command, are kept: they may be names of files.
    """
    kept = {name for word in given for name in _OPTION.findall(word)}

    def write(found: re.Match[str]) -> str:
        return found[0] if found[0] in kept else f"--{found[0].replace('_', '-')}"

    return _OPTION.sub(write, join_lines(text))
