"""Scores of the pictures of a folder against those of another one with the same names."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

from ciir.errors import InputError
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import DEPTH_SENSE_TEXT
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.png import find_text
from ciir.renderer.readers.registry import is_picture
from ciir.training.data.light_field.views import drop_alpha
from ciir.training.evaluation.metrics import average
from ciir.training.evaluation.pairs import White, check_sizes, score_view
from ciir.training.evaluation.pictures import Measured

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray


def is_set(path: Path) -> bool:
    """Returns whether `path` is a folder or a zip. False if it can't be read."""
    try:
        return Bundle.from_path(path).main is None
    except InputError:
        return False


def compare_by_name(result: Path, truth: Path, *, border: int) -> Measured:
    """Scores each picture of `result`, a folder or a zip, against the one of the same name, suffix aside, in `truth`.

    A border of `border` pixels is cut. All of them have one white level, that of the truth's. A note states the number
    of pairs, and how many pictures have no partner.

    Raises `ValueError` if no names are equal, one name is there twice, a picture can't be read, or the two of a pair
    differ in size or channels.
    """
    found, true = _find_pictures(result), _find_pictures(truth)
    names = [name for name in true if name in found]
    if not names:
        raise ValueError(
            f"{result}: no picture in it has the name of one in {truth}; give folders with the same names in both"
        )
    senses = [find_text(pictures[names[0]].load(), DEPTH_SENSE_TEXT) for pictures in (found, true)]
    if None not in senses and senses[0] != senses[1]:
        raise ValueError(
            f"{result}: its views count {senses[0]}, those of {truth} {senses[1]}, so equal names are other views; "
            "give whole light fields, or sets of one depth sense"
        )
    white = White(true[name].read() for name in names)
    scores = {}
    for name in names:
        made, wanted = found[name].read(), true[name].read()
        check_sizes(str(found[name].path), made.shape, str(true[name].path), wanted.shape, border=border)
        scores[found[name].key] = score_view(made[0, 0], wanted[0, 0], white, border=border)
    compared = f"{len(names):,} of {len(true):,} pictures of {truth.name}"
    note = f"{compared} are compared with those of the same name in {result.name}"
    alone = [picture.key for name, picture in true.items() if name not in found]
    if alone:
        note += f"; {len(alone):,} have no partner, such as {clean_text(alone[0])}"
    if extra := len(found) - len(names):
        note += f"; {extra:,} more in {result.name} are left out"
    return Measured(average(result.name, scores), scores, (note, *white.describe(result.name, truth.name)))


def read_picture(data: bytes, path: Path) -> LightField:
    """Reads a picture, grey or RGB, as the one view of a light field. `path` is its place, for messages.

    Raises `ValueError` if it can't be read or is see-through.
    """
    try:
        pixels = pictures.decode(data, name=path.name)
    except InputError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path.name}: ')}") from error
    return drop_alpha(LightField(pixels[None, None], is_ordered=True), path)


class _Picture(NamedTuple):
    key: str
    """Its name in the folder or zip."""
    path: Path
    """Its place, for messages."""
    files: Mapping[str, bytes]
    """All files of the folder or zip."""

    def load(self) -> bytes:
        return self.files[self.key]

    def read(self) -> NDArray[Any]:
        return read_picture(self.load(), self.path).views


def _find_pictures(path: Path) -> dict[str, _Picture]:
    """Returns the pictures in a folder or a zip by their names without suffixes and a folder that holds all, sorted."""
    files = Bundle.from_path(path).files
    keys = sorted(filter(is_picture, files))
    folder = os.path.commonpath([PurePosixPath(key).parent for key in keys]) if keys else ""
    found: dict[str, _Picture] = {}
    for key in keys:
        name = str(PurePosixPath(key).with_suffix("").relative_to(folder))
        if name in found:
            raise ValueError(f"{path}: {clean_text(found[name].key)} and {clean_text(key)} have one name; remove one")
        found[name] = _Picture(key, path / key, files)
    return found
