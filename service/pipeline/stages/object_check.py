"""Checks that rendered views show their object, and that it stands out from the background."""

from __future__ import annotations

from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

DIFFERENCE = 16
"""Levels of 8 bits by which a pixel must differ from the background, in some channel, to stand out."""
LEAST_SHARE = 0.05
"""Share of the object's pixels that must stand out in some picture, or a note is written."""
HARDLY_SEEN = "the object hardly stands out from the background"
"""What that note begins with."""


class ObjectCheck:
    """Counts how much of an object stands out from the background, until one picture shows that it does."""

    def __init__(self, background: tuple[int, int, int], *, hides_backs: bool = False) -> None:
        """`hides_backs`: whether some of the object's materials hide the backs of their faces."""
        self._background, self._hides_backs = background, hides_backs
        self._low = [max(level - DIFFERENCE, 0) for level in background]
        self._high = [min(level + DIFFERENCE, 255) for level in background]
        self._covered = self._outstanding = 0
        self._lock = Lock()

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Counts a picture `(..., 4)`, RGBA, whose alpha is the share of a pixel that the object covers."""
        if self._outstanding <= LEAST_SHARE * self._covered:
            self.count(picture)

    def count(self, picture: NDArray[np.uint8]) -> None:
        """Counts a picture like `add`, whatever was counted before: neither order nor thread matters."""
        covered = picture[..., 3] > 0
        stands_out = np.zeros_like(covered)
        for channel, (low, high) in enumerate(zip(self._low, self._high, strict=True)):  # an axis of three is slow
            stands_out |= (picture[..., channel] < low) | (picture[..., channel] > high)
        with self._lock:
            self._covered += int(np.count_nonzero(covered))
            self._outstanding += int(np.count_nonzero(stands_out & covered))

    def list_notes(self) -> list[str]:
        """Returns a note if no picture showed the object, or if it hardly stands out."""
        if not self._covered:
            cause = "it is smaller than a pixel, edge-on, or outside them"
            remedy = "give another rotate, zoom or delta, more lenses, or other views"
            if self._hides_backs:
                cause += ", or only back faces are seen, which its materials hide"
                remedy += ", or make the materials double-sided"
            return [f"none of the requested views shows the object: {cause}; {remedy}"]
        if self._outstanding > LEAST_SHARE * self._covered:
            return []
        given = "{:02x}{:02x}{:02x}".format(*self._background)
        other = "ffffff" if sum(self._background) < 3 * 128 else "000000"
        share = f"{100 * self._outstanding / self._covered:.1f} % of its pixels"
        note = f"{HARDLY_SEEN} {given}: {share} differ by over {DIFFERENCE} levels"
        return [f"{note}; give another one, such as background {other}"]
