"""Formats the errors and notes of the command line."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import PurePath
from typing import TYPE_CHECKING

from ciir.service.errors import join_lines
from ciir.service.pipeline.options import OPTIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

_NAMES = (*OPTIONS, "show_grid")
_VALUES = {name: option.type.schema.get("enum", []) for name, option in OPTIONS.items()} | {
    "lens_pitch": ["auto"],
    "model": ["auto", "none", "bicubic", "fast"],
    "views": ["all"],
}
"""Words that only the value of an option can be where they follow its name."""
_WITH_WORD = {"--to"} | {
    f"--{name.replace('_', '-')}"
    for name, option in OPTIONS.items()
    if not option.flag and option.placeholder != "FILE"
}
"""Options before a word that is no name of a file, such as `--to quilt`."""
_FORM = r"\d+x\d+|-?\d+:[\d:.-]*\d|[A-Z]+[x,][A-Z,]+"
"""Values such as `50x50`, `0:360:60` and `ROWSxCOLUMNS`."""
_BEFORE, _AFTER = r"""(?<![\w./\\'"-])""", r"""(?![\w/\\'"-]|\.\w)"""
"""Around words of a sentence: not parts of paths, and not quoted values."""
_VALUED = "|".join(
    [
        f"(?:{'|'.join(name for name in _NAMES if not _VALUES.get(name))}) (?:{_FORM})",
        *(f"{name} (?:{'|'.join([*words, _FORM])})" for name, words in _VALUES.items() if words),
    ]
)
_ITEM = f"(?:{_VALUED}|{'|'.join(_NAMES)}){_AFTER}"
_MORE = f"(?:(?:,| and| or|, and|, or) {_ITEM})"
_NUMBER = r"(?: \d[\d.]*(?:in)?(?![\w/]))?"
"""A number after an item."""
_END = r"(?=[;,.)]|$| \(| (?:out|too|and|or|as|in pixels|in millimetres|instead|of its|to|that|with)\b)"
_LEAD = "|".join(rf"(?<=\b{word} )" for word in ("give", "give another", "leave", "need", "needs", "with", "one of"))
_OWN = "|".join(name for name in _NAMES if "_" in name)
_HEADING = f"{_ITEM}{_MORE}*(?=:)"
"""Options that a message is about. Like those below, it is compiled by the first message: that takes 40 ms."""
_PLACES = (
    f"(?:{_LEAD}){_ITEM}{_NUMBER}(?:{_MORE}{_NUMBER})*{_END}"
    f"|{_BEFORE}(?:{_VALUED}){_AFTER}(?: {_ITEM})?"
    f"|{_BEFORE}(?:{_OWN}){_AFTER}(?:{_MORE}+{_END})?"
    f"|{_BEFORE}(?:{'|'.join(_NAMES)})(?= (?:gives|selects)\\b)"
)
"""Where names are those of options and no plain words: in remedies, before values, and names that no plain word has."""
_OPTION = f"{_BEFORE}(?:{_VALUED}|{'|'.join(_NAMES)}){_AFTER}"


def format_message(text: str, given: Sequence[str] | None = None) -> str:
    """Formats a message as one line, with options as they are typed: `--lens-pitch auto` for `lens_pitch auto`.

    `given`: the arguments of the command, or other names of files, for an error. Names of options in them are kept,
    except in values that are no names of files. None: the text is a note, whose first word may be plain.
    """
    files = [word for before, word in pairwise(["", *(given or ())]) if before not in _WITH_WORD]
    kept = {name for word in files for name in _NAMES if name in (*word.split(), PurePath(word).name)}
    written: set[str] = set()

    def write(found: re.Match[str]) -> str:
        name, _, value = found[0].partition(" ")
        if name in kept:
            return found[0]
        written.add(name)
        return f"--{name.replace('_', '-')}{value and ' '}{value}"

    line = re.sub(_PLACES, lambda found: re.sub(_OPTION, write, found[0]), join_lines(text))
    heading = re.match(_HEADING, line)
    if heading and (given is not None or not written.isdisjoint(heading[0].split(", "))):
        line = re.sub(_OPTION, write, heading[0]) + line[heading.end() :]
    return line
