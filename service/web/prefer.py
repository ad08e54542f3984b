"""The `Prefer` header (RFC 7240): whether a client waits for a result, and how long."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_WAIT = re.compile(r'wait\s*=\s*"?(\d{1,9})"?$')


@dataclass(frozen=True)
class Preference:
    """What of the header counts here; all else in it is ignored, as the RFC has it."""

    is_async: bool = False
    """`respond-async` was given."""
    wait: int | None = None
    """Seconds; None where `wait` wasn't given, or is no whole number."""

    @classmethod
    def parse(cls, headers: Iterable[str]) -> Preference:
        """Of all `Prefer` headers of a request; the first of a kind counts."""
        is_async, wait = False, None
        for preference in ",".join(headers).split(","):
            word = preference.partition(";")[0].strip().lower()
            found = _WAIT.match(word)
            is_async = is_async or word == "respond-async"
            wait = int(found[1]) if found and wait is None else wait
        return cls(is_async, wait)

    def wait_seconds(self, most: float) -> float:
        """How long to wait, where the server waits for `most` seconds."""
        if self.wait is None:
            return 0.0 if self.is_async else most
        return min(float(self.wait), most)

    def format_applied(self, most: float) -> str:
        """`Preference-Applied`: what was done as it was asked for; empty for nothing."""
        done = ["respond-async"] if self.is_async else []
        if self.wait is not None and self.wait <= most:
            done.append(f"wait={self.wait}")
        return ", ".join(done)
