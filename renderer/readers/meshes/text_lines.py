"""Sorts the lines of a text by their first words and counts and parses numbers in them, without a loop over lines."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

_SPACE = np.isin(np.arange(256), list(b" \t\n\r\v\f"))
_NEWLINE = ord("\n")
_LOWER = 0x20
"""The bit that makes a letter lower case."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Lines of a text that start with the same word, in the order of the text."""

    numbers: NDArray[np.int64]
    """The line numbers, from 0."""
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    """The start and end of each line in the text. The end is after the line break."""
    widths: NDArray[np.int64]
    """The number of words in each line after the first word."""

    def __len__(self) -> int:
        return len(self.numbers)

    def select(self, chosen: NDArray[np.bool_]) -> Rows:
        """Returns the rows where `chosen` is true."""
        return Rows(self.numbers[chosen], self.starts[chosen], self.ends[chosen], self.widths[chosen])

    def join(self, text: bytes) -> bytes:
        """Returns the lines, one after another."""
        if not len(self):
            return b""
        follows = self.starts[1:] == self.ends[:-1]
        begins = self.starts[np.r_[True, ~follows]].tolist()
        finishes = self.ends[np.r_[~follows, True]].tolist()
        return b"".join(text[begin:end] for begin, end in zip(begins, finishes, strict=True))


def sort_lines(text: bytes, words: Sequence[bytes]) -> dict[bytes, Rows]:
    """Returns the lines that start with each of `words`, in lower or upper case. `words` must be in lower case."""
    data = np.frombuffer(text + b"\n" + b" " * max(map(len, words)), np.uint8)
    ends = np.flatnonzero(data == _NEWLINE) + 1
    starts = np.concatenate([[0], ends[:-1]])
    begins = find_words(data)
    counts = _count_in_lines(begins, starts)
    filled = np.flatnonzero(counts)
    first = np.flatnonzero(begins)[(np.cumsum(counts) - counts)[filled]]
    rows = {}
    for word in words:
        matches = _SPACE[data[first + len(word)]]
        for place, letter in enumerate(word):
            matches &= data[first + place] | _LOWER == letter
        chosen = filled[matches]
        rows[word] = Rows(chosen, starts[chosen], ends[chosen], counts[chosen] - 1)
    return rows


def find_words(data: NDArray[np.uint8], between: bytes = b"") -> NDArray[np.bool_]:
    """Marks where words begin in `data`. Words are separated by spaces and by the characters in `between`."""
    parts = _SPACE | np.isin(np.arange(256), list(between)) if between else _SPACE
    parting = parts[data]
    begins = ~parting
    begins[1:] &= parting[:-1]
    return begins


def count_in_rows(marks: NDArray[np.bool_], rows: Rows) -> NDArray[np.int64]:
    """Counts the `marks` in each row. There is one mark for each character of `rows.join()`."""
    lengths = rows.ends - rows.starts
    return _count_in_lines(marks, np.cumsum(lengths) - lengths)


def _count_in_lines(marks: NDArray[np.bool_], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.add.reduceat(marks, starts, dtype=np.int64) if len(starts) else np.zeros(0, np.int64)


def list_words(joined: bytes, widths: NDArray[np.int64], most: int | None = None) -> Iterator[bytes]:
    """Yields the words of joined rows without the first word of each, at most `most` per row. `widths`: see `Rows`."""
    counts = widths + 1
    place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    wanted = place > 0 if most is None else (place > 0) & (place <= most)
    return compress(joined.split(), wanted.tobytes())
