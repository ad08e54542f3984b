"""Stress cases: functions that measure numbers, each with a bound."""

from __future__ import annotations

from dataclasses import dataclass
from functools import wraps
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol

from ciir.errors import advise_extra

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@dataclass(frozen=True)
class Found:
    """One measured number and its bound, which holds if `measured <= bound`; NaN never holds."""

    what: str
    """The quantity with its unit: `fast against fast-int8, worst pixel of noise, levels of 8 bits`."""
    bound: float
    measured: float
    where: str = ""
    """The input that came closest to the bound: `1x37, checkerboard`."""

    @property
    def holds(self) -> bool:
        """Whether the bound holds."""
        return bool(self.measured <= self.bound)  # NaN does not hold; and numpy's bool is not JSON's


@dataclass(frozen=True)
class Skipped:
    """A quantity that could not be measured on this machine, and the reason, with the remedy."""

    what: str
    why: str


@dataclass(frozen=True)
class Effort:
    """How much is tested."""

    models: tuple[str, ...]
    """The networks to stress; all of them run on this processor."""
    quick: bool = False
    """Only a few sizes and rounds, for the smoke test."""


class Case(Protocol):
    """A function that measures; its name and the first line of its docstring are its report's title."""

    __name__: str

    def __call__(self, effort: Effort) -> Iterator[Found | Skipped]:
        """Yields each result when it is measured; deterministic, apart from the timing of threads."""
        ...


def skip_without(package: str, what: str) -> Callable[[Case], Case]:
    """Makes a case yield one `Skipped` for `what` if a package of the training extra is not installed."""

    def decorate(case: Case) -> Case:
        @wraps(case)
        def run(effort: Effort) -> Iterator[Found | Skipped]:
            if find_spec(package) is None:
                yield Skipped(what, f"needs {package}: {advise_extra('training')}")
            else:
                yield from case(effort)

        return run

    return decorate
