"""What can be wrong with the jobs themselves, whatever was asked for."""

from __future__ import annotations


class QueueFull(Exception):  # noqa: N818 - the cause is the name
    """As many jobs wait as may: HTTP's 429."""

    def __init__(self, retry_after: int) -> None:
        super().__init__(f"the queue is full; try again in {retry_after} s")
        self.retry_after = retry_after
        """Whole seconds, a guess."""


class Unavailable(Exception):  # noqa: N818
    """The queue can't be reached, or its disk is full: HTTP's 503. `str()` is one line with the remedy."""


class Gone(LookupError):  # noqa: N818
    """The result was kept for as long as it may be, and removed: HTTP's 410; asked for again it is made again."""


class WorkerDied(Exception):  # noqa: N818
    """The worker process ended in the middle of its work: it was killed, or crashed."""


class Cancelled(Exception):  # noqa: N818
    """The work was stopped because it is not wanted any more."""
