"""Groups file names by the numbers in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

MOST_CHARACTERS = 1024
"""The most characters of a name, including its folders; numbers in longer names are ignored."""
MOST_NUMBERS = 12
"""How many of the last numbers in a name may differ from file to file; those before them may not."""
_NUMBER = re.compile(
    r"(?:(?<![0-9a-z])-)?"  # a sign, but not the hyphen of view-3-5
    r"(?:(?<!\.)\d{1,18}\.\d{1,18}|\d{1,18})"  # a fraction, but not that of view.3.5
)


@dataclass(frozen=True)
class NumberedNames:
    """Names that differ only in their numbers."""

    texts: tuple[str, ...]
    """The text before each number, in lower case."""
    files: list[str]
    numbers: list[list[str]]
    """The numbers of each file, as they are written."""

    @cached_property
    def positions(self) -> list[int]:
        """The numbers that have a fraction in some file."""
        return [slot for slot in range(len(self.texts)) if any("." in numbers[slot] for numbers in self.numbers)]

    @cached_property
    def varying(self) -> list[int]:
        """The numbers without a fraction that differ from file to file."""
        whole = [slot for slot in range(len(self.texts)) if slot not in self.positions]
        return [slot for slot in whole if len(set(self.values(slot))) > 1]

    def values(self, slot: int) -> list[int]:
        """Returns the values of one number without a fraction, for each file."""
        return [int(numbers[slot]) for numbers in self.numbers]


def group_by_kind(files: Sequence[str]) -> list[NumberedNames]:
    """Groups the names that differ only in their numbers."""
    kinds: dict[tuple[str, ...], NumberedNames] = {}
    for file in files:
        stem = str(PurePosixPath(file).with_suffix("")).lower().rstrip("_")
        is_short = len(stem) <= MOST_CHARACTERS
        texts = tuple(_NUMBER.split(stem)) if is_short else (stem,)
        numbers = _NUMBER.findall(stem) if is_short else []
        key = (*texts, *numbers[:-MOST_NUMBERS])
        kind = kinds.setdefault(key, NumberedNames(texts[-MOST_NUMBERS - 1 : -1], [], []))
        kind.files.append(file)
        kind.numbers.append(numbers[-MOST_NUMBERS:])
    return list(kinds.values())


def find_step(values: Sequence[int]) -> int:
    """Returns the difference between each value and the next larger one: 1 for a single value, 0 if the difference
    varies.
    """
    steps = {after - before for before, after in pairwise(sorted(set(values)))}
    return 0 if len(steps) > 1 else next(iter(steps), 1)
