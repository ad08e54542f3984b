"""Stress cases: functions that measure numbers, each with a bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(frozen=True)
class Found:
    """One measured number and its bound, which holds where `measured <= bound`; NaN never holds."""

    what: str
    """The quantity with its unit: `fast against fast-int8, worst pixel of noise, levels of 8 bits`."""
    bound: float
    measured: float
    where: str = ""
    """The input that came closest to the bound: `1x37, checkerboard`."""

    @property
    def holds(self) -> bool:
        """Whether the bound holds."""
        return bool(self.measured <= self.bound)  # NaN does not; and numpy's bool is not JSON's


@dataclass(frozen=True)
class Skipped:
    """A quantity that could not be measured here, and why, with the remedy."""

    what: str
    why: str


@dataclass(frozen=True)
class Effort:
    """How much is tried."""

    models: tuple[str, ...]
    """The networks to stress; all of them run on this processor."""
    quick: bool = False
    """A few sizes and rounds in place of all, for the smoke test."""


class Case(Protocol):
    """A function that measures; its name and the first line of its docstring are its report's title."""

    __name__: str

    def __call__(self, effort: Effort) -> Iterator[Found | Skipped]:
        """Yields each result when it is measured; deterministic, apart from the timing of threads."""
        ...
