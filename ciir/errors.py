"""Every error that callers of `ciir` can meet, drawn once.

::

    Error                        the root: `except ciir.Error` catches all of them; the message is one line
    ├── InputError               the input or an option is wrong: what was given, the limit, the remedy
    │   ├── UnsupportedType      not a kind of file that is read, or not the kind that its name says
    │   ├── Unreadable           truncated, corrupt, or not decodable
    │   ├── TooLarge             over a limit on bytes, pixels, files or triangles
    │   ├── InvalidGeometry      no surface, not finite, or out of range
    │   │   └── NothingVisible   there are triangles, but all have zero area, or none is before the camera
    │   └── InvalidOption        an option that is wrong by itself or does not fit the input
    ├── BackendUnavailable       the rendering backend that was asked for can't run on this machine
    ├── ModelError               the model that was asked for, or its input, is wrong
    │   ├── UnknownModel         no model of that name
    │   ├── UnsupportedScale     the model doesn't upscale by that factor
    │   ├── UnsuitedModel        for single pictures where views of a light field are given, or the other way round
    │   ├── UnsuitedProcessor    the network is an int8 one, which this machine's processor gets wrong
    │   ├── InvalidImage         not an array of pictures of the shape, type and range that models take
    │   └── BadCard              a card, or the network beside it, is missing, incomplete or doesn't fit
    ├── BrokenNetwork            a network turned good input into something that is not a number
    ├── JobError                 a job of the service could not be taken or finished
    │   ├── QueueFull            as many jobs wait as may
    │   ├── QueueUnavailable     the queue can't be reached, or its disk is full
    │   ├── ResultExpired        the result was kept for as long as it may be, and removed
    │   ├── WorkerDied           the worker process ended in the middle of its work
    │   │   └── TimedOut         it was ended, as the work took all the time that a job has
    │   └── Cancelled            the work was stopped because it is not wanted any more
    ├── NotReady                 the server is still loading its models, or it is stopping
    └── ServiceError             a server's answer can't be used (`ciir.service.client`)
        ├── ConnectionFailed     the server can't be reached, or the connection broke
        ├── Unauthorized         the API key is missing or wrong
        ├── NotFound             there is no such job
        └── NotDone              the job waits or runs
"""

from __future__ import annotations


def advise_extra(extra: str) -> str:
    """For messages: how to install an extra of pyproject.toml. `ciir` is on no package index, but in a folder."""
    return f"pip install '.[{extra}]' in the folder of ciir's source code"


class Error(Exception):
    """The root of all errors of `ciir`; `str()` is one line with what was given, the limit and the remedy."""


class InputError(Error, ValueError):
    """The input or an option is wrong."""


class UnsupportedType(InputError):  # noqa: N818 - the cause is the name, here and below
    """Not a kind of file that is read, or not the kind that its name says."""


class Unreadable(InputError):  # noqa: N818
    """Truncated, corrupt, or not decodable."""


class TooLarge(InputError):  # noqa: N818
    """Over a limit on bytes, pixels, files or triangles."""

    def __init__(self, message: str, limit: str = "", needed: int = 0) -> None:
        super().__init__(message)
        self.limit = limit
        """Name of the limit in `renderer.limits.Limits`; empty for a fixed one."""
        self.needed = needed
        """A value of that limit that suffices; 0 where it isn't known."""


class InvalidGeometry(InputError):  # noqa: N818
    """No surface, not finite, or out of range."""


class NothingVisible(InvalidGeometry):
    """There are triangles, but all have zero area, or none is before the camera: at another time that may differ."""


class InvalidOption(InputError):  # noqa: N818
    """An option that is wrong by itself or does not fit the input."""


class BackendUnavailable(Error, RuntimeError):  # noqa: N818
    """The rendering backend that was asked for can't run on this machine."""


class ModelError(Error, ValueError):
    """The model that was asked for, or its input, is wrong."""


class UnknownModel(ModelError):  # noqa: N818
    """No model of that name."""


class UnsupportedScale(ModelError):  # noqa: N818
    """The model doesn't upscale by that factor."""


class UnsuitedModel(ModelError):  # noqa: N818
    """The model takes single pictures where a light field's views are given, or the other way round."""


class UnsuitedProcessor(ModelError):  # noqa: N818
    """The network is an int8 one, which this machine's processor gets wrong, or can't be known to get right."""


class InvalidImage(ModelError):  # noqa: N818
    """Not an array of pictures of the shape, type and range that models take."""


class BadCard(ModelError):  # noqa: N818
    """A card, or the network beside it, is missing, incomplete or doesn't fit."""


class BrokenNetwork(Error, RuntimeError):  # noqa: N818
    """A network turned good input into something that is not a number: its weights are wrong, not the picture."""


class JobError(Error):
    """A job of the service could not be taken or finished."""


class QueueFull(JobError):  # noqa: N818
    """As many jobs wait as may: HTTP's 429."""

    def __init__(self, detail: str, retry_after: int = 1) -> None:
        super().__init__(detail)
        self.retry_after = retry_after
        """Whole seconds, an estimate."""

    def __reduce__(self) -> tuple[type[QueueFull], tuple[str, int]]:
        """For pickle, which would leave out the seconds."""
        return type(self), (str(self), self.retry_after)


class QueueUnavailable(JobError):  # noqa: N818
    """The queue can't be reached, or its disk is full: HTTP's 503."""


class ResultExpired(JobError, LookupError):  # noqa: N818
    """The result was kept for as long as it may be, and removed: HTTP's 410. A new request makes it again."""


class WorkerDied(JobError):  # noqa: N818
    """The worker process was killed, or crashed, in the middle of its work."""


class TimedOut(WorkerDied):
    """The worker process was ended in the middle of its work, on which it had spent all the time that a job has."""


class Cancelled(JobError):  # noqa: N818
    """The work was stopped because it is not wanted any more."""


class NotReady(Error, RuntimeError):  # noqa: N818
    """The server is still loading its models, or it is stopping."""


class ServiceError(Error):
    """A server's answer can't be used: none of the other errors fits it."""


class ConnectionFailed(ServiceError, ConnectionError):  # noqa: N818
    """The server can't be reached, or the connection broke."""


class Unauthorized(ServiceError):  # noqa: N818
    """The API key is missing or wrong: HTTP's 401."""


class NotFound(ServiceError, LookupError):  # noqa: N818
    """There is no such job: HTTP's 404."""


class NotDone(ServiceError):  # noqa: N818
    """The job waits or runs: HTTP's 409."""
