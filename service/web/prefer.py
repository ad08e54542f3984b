"""The `Prefer` header (RFC 7240): whether and how long a client waits for a result."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_WAIT = re.compile(r'wait\s*=\s*"?(\d{1,9})"?$')


@dataclass(frozen=True)
class Preference:
    """The preferences that the API supports. All others are ignored, as the RFC demands."""

    is_async: bool = False
    """Whether `respond-async` was sent."""
    wait: int | None = None
    """Seconds; None if `wait` was not sent or is not a whole number."""

    @classmethod
    def parse(cls, headers: Iterable[str]) -> Preference:
        """Parses all `Prefer` headers of a request. The first preference of a name counts."""
        is_async, wait = False, None
        for preference in ",".join(headers).split(","):
            name = preference.partition(";")[0].strip().lower()
            match = _WAIT.match(name)
            is_async = is_async or name == "respond-async"
            wait = int(match[1]) if match and wait is None else wait
        return cls(is_async, wait)

    def wait_seconds(self, limit: float) -> float:
        """Returns how long to wait on a server that waits at most `limit` seconds."""
        if self.wait is None:
            return 0.0 if self.is_async else limit
        return min(float(self.wait), limit)

    def format_applied(self, limit: float) -> str:
        """Returns the value of `Preference-Applied`: the preferences that were followed; empty if none."""
        applied = ["respond-async"] if self.is_async else []
        if self.wait is not None and self.wait <= limit:
            applied.append(f"wait={self.wait}")
        return ", ".join(applied)
