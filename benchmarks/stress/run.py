"""Runs the stress cases and reports each bound, what was measured, and whether the bound holds."""

from __future__ import annotations

import importlib
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ciir.benchmarks import machine
from ciir.benchmarks.stress.case import Found, Skipped
from ciir.errors import InvalidOption
from ciir.models import catalogue
from ciir.service.errors import join_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ciir.benchmarks.stress.case import Case, Effort

GROUPS = {
    "signals": "ciir.benchmarks.stress.networks.signals",
    "sizes": "ciir.benchmarks.stress.networks.sizes",
    "layers": "ciir.benchmarks.stress.networks.layers",
    "gain": "ciir.benchmarks.stress.networks.gain",
    "invariance": "ciir.benchmarks.stress.networks.invariance",
    "rounds": "ciir.benchmarks.stress.networks.rounds",
    "cliffs": "ciir.benchmarks.stress.networks.cliffs",
    "geometry": "ciir.benchmarks.stress.geometry.views",
    "training": "ciir.benchmarks.stress.training",
}
"""Name -> the module whose `CASES` belong to it; imported when the group runs."""


@dataclass(frozen=True)
class Outcome:
    """One result of a case."""

    group: str
    case: str
    result: Found | Skipped
    seconds: float
    """Seconds since the case's last result or its start."""
    failure: str = ""
    """The exception that ended the case, in one line; empty if there was none."""

    @property
    def state(self) -> str:
        """`ok`, `BROKEN` or `skipped`."""
        if isinstance(self.result, Skipped):
            return "skipped"
        return "ok" if self.result.holds else "BROKEN"

    def format_line(self) -> str:
        """Formats one line of the report."""
        if isinstance(self.result, Skipped):
            return f"skipped  {self.result.what}: {self.result.why}"
        bound, measured, where = f"{self.result.bound:.4g}", f"{self.result.measured:.4g}", self.result.where
        return f"{self.state:7s}  {self.result.what:72s} {bound:>10s} {measured:>10s}  {self.failure or where}".rstrip()

    def as_dict(self) -> dict[str, Any]:
        """Returns the outcome for JSON, which has no NaN or infinity: `bound` or `measured` is then null, and a key
        that ends in `_word` holds the text.
        """
        plain: dict[str, Any] = {"group": self.group, "case": self.case, "what": self.result.what, "state": self.state}
        if isinstance(self.result, Skipped):
            return plain | {"why": self.result.why, "seconds": round(self.seconds, 3)}
        for key, value in (("bound", self.result.bound), ("measured", self.result.measured)):
            number = float(value)
            plain |= {key: number} if math.isfinite(number) else {key: None, f"{key}_word": str(number)}
        return plain | {
            "where": self.result.where,
            "holds": self.result.holds,
            "failure": self.failure,
            "seconds": round(self.seconds, 3),
        }


def select_groups(names: Sequence[str]) -> tuple[str, ...]:
    """Returns the groups to run, in the order of `GROUPS`; all if `names` is empty. Raises `InvalidOption` for other
    names.
    """
    for name in names:
        if name not in GROUPS:
            raise InvalidOption(f"--only: no group {name[:40]!r}; give some of {', '.join(GROUPS)}")
    return tuple(name for name in GROUPS if not names or name in names)


def select_models(names: Sequence[str]) -> tuple[tuple[str, ...], list[Skipped]]:
    """Returns the networks to stress, all if `names` is empty, and those that this processor can't run.

    Only single-picture networks are included.

    Raises `InvalidOption` for other names.
    """
    singles = catalogue.list_single_image_names()
    networks = {
        entry.name: entry for entry in catalogue.list_entries() if entry.card is not None and entry.name in singles
    }
    for name in names:
        if name not in networks:
            raise InvalidOption(f"--model: no network {name[:40]!r} here; give some of {', '.join(networks)}")
    selected = [entry for name, entry in networks.items() if not names or name in names]
    unsuited = [
        Skipped(entry.name, f"{entry.unsupported_reason}; another machine is needed")
        for entry in selected
        if entry.unsupported_reason
    ]
    return tuple(entry.name for entry in selected if not entry.unsupported_reason), unsuited


def run_cases(groups: Sequence[str], effort: Effort) -> Iterator[Outcome]:
    """Yields the outcomes of all cases of `groups`. An exception ends its case and counts as broken."""
    for group in groups:
        for case in importlib.import_module(GROUPS[group]).CASES:
            yield from run_case(group, case, effort)


def run_case(group: str, case: Case, effort: Effort) -> Iterator[Outcome]:
    """Yields the outcomes of one case."""
    begun = time.perf_counter()
    results = case(effort)
    while True:
        failure = ""
        try:
            result = next(results)
        except StopIteration:
            return
        except Exception as error:  # noqa: BLE001 - reported as broken; the other cases still run
            failure = join_lines(f"{type(error).__name__}: {error}")
            result = Found(f"{case.__name__} raised an exception", 0, math.nan)
        ended = time.perf_counter()
        yield Outcome(group, case.__name__, result, ended - begun, failure)
        begun = ended
        if failure:
            return


def stress(
    groups: Sequence[str], effort: Effort, *, write: Callable[[str], object], skipped: Sequence[Skipped] = ()
) -> dict[str, Any]:
    """Runs `groups`, passes each line to `write`, and returns the results for JSON. `skipped` are reported first."""
    begun = time.perf_counter()
    write(f"{'':7s}  {'what was bounded':72s} {'bound':>10s} {'measured':>10s}  where")
    found = [Outcome("", "", result, 0.0) for result in skipped]
    for outcome in found:
        write(outcome.format_line())
    for outcome in run_cases(groups, effort):
        found.append(outcome)
        write(outcome.format_line())
    states = [outcome.state for outcome in found]
    seconds = time.perf_counter() - begun
    counts = {state: states.count(state) for state in ("ok", "BROKEN", "skipped")}
    write(f"{counts['ok']} hold, {counts['BROKEN']} broken, {counts['skipped']} skipped, in {seconds:.0f} s")
    return {
        "broken": counts["BROKEN"],
        "quick": effort.quick,
        "models": list(effort.models),
        "groups": list(groups),
        "seconds": round(seconds, 1),
        "machine": machine.describe(),
        "results": [outcome.as_dict() for outcome in found],
    }
