"""What a stress case is: a function that measures numbers, each held against a bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(frozen=True)
class Found:
    """One number that was bounded, and what it came to. It holds where `measured <= bound`; NaN never does."""

    what: str
    """What was bounded, in words, with its unit: `fast against fast-int8, worst pixel of noise, levels of 8 bits`."""
    bound: float
    measured: float
    where: str = ""
    """The input that came closest to the bound, where that helps: `1x37, checkerboard`."""

    @property
    def holds(self) -> bool:
        """Whether the bound holds."""
        return bool(self.measured <= self.bound)  # NaN is not; numpy's own truth is no JSON


@dataclass(frozen=True)
class Skipped:
    """Something that could not be measured here, and why, with the remedy."""

    what: str
    why: str


@dataclass(frozen=True)
class Effort:
    """How much is tried."""

    models: tuple[str, ...]
    """The catalogue's networks that are stressed; those that this machine's processor can't run are left out."""
    quick: bool = False
    """A few sizes and rounds in place of all: for the smoke test, seconds in all."""


class Case(Protocol):
    """A function of this shape; its name and the first line of its docstring are what the report calls it."""

    __name__: str

    def __call__(self, effort: Effort) -> Iterator[Found | Skipped]:
        """Measures; deterministic, but for what timing of threads may change. Yields as soon as it knows."""
        ...
