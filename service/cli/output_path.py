"""Decides by its suffix whether `-o` names a file or a folder, and refuses unknown suffixes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import place_for_file
from ciir.renderer.writers.options import TEXT_FILES

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence


def names_file(text: str, suffixes: Sequence[str], *, what: str) -> bool:
    """Checks whether `text` names a file with one of `suffixes` (lower case) rather than a folder, for writing `what`.

    A folder that exists and a name that ends with `/` are folders, whatever their suffix, and so is a name without one.
    Raises `InvalidOption` if `text` is empty or has another suffix, which may be mistyped.
    """
    if not text:
        raise InvalidOption(f"-o: '' is not a name; give one for {what}")
    path = Path(text)
    suffix = path.suffix.lower()
    if text.endswith("/") or path.is_dir():
        return False
    if suffix and suffix not in suffixes:
        ends = f"{', '.join(suffixes)}, or / for a folder" if suffixes else "/ for a folder"
        raise InvalidOption(f"{text}: {what} can't be written as {suffix}; end the name with {ends}")
    return suffix in suffixes


def resolve_folder(text: str, *, what: str) -> Path:
    """Returns the folder that `text` names. Raises the same errors as `names_file`."""
    names_file(text, (), what=what)
    return Path(text)


def check_places(args: argparse.Namespace, *others: str | Path) -> None:
    """Checks that no output overwrites an input, and that the report can be written.

    Raises `InvalidOption` if an output of `args`, or one of `others`, is a file that the command reads (also through a
    link) or lies in a folder that it reads, if two outputs are the same file, or if the report can't be written.
    """
    given = vars(args)
    if args.report is not None:
        if not args.report:
            raise InvalidOption("--report: '' is not a name; name a file for the report")
        place_for_file(Path(args.report))
    inputs = ["input", "white", "dark", *(f"option_{name}" for name in TEXT_FILES)]
    sources = [Path(given[name]).resolve() for name in inputs if given.get(name)]
    outputs = [given["out"], *(given.get(name) for name in ("report", "show_grid")), *others]
    taken: set[Path] = set()
    for path in (Path(output) for output in outputs if output):
        place = path.resolve()
        if any(place == source or (source.is_dir() and place.is_relative_to(source)) for source in sources):
            raise InvalidOption(f"{path}: the input is there; give another place for the output, so that it isn't lost")
        if place in taken:
            raise InvalidOption(f"{path}: two outputs have this name; give each its own")
        taken.add(place)
