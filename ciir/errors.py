"""All errors that `ciir` raises, drawn as one tree.

::

    Error                        the root: `except ciir.Error` catches all of them; the message is one line
    ├── InputError               the input or an option is wrong: what was given, the limit, the remedy
    │   ├── UnsupportedType      the file's type is not read, or is not the one that its name says
    │   ├── Unreadable           truncated, corrupt, or not decodable
    │   ├── TooLarge             over a limit on bytes, pixels, files or triangles
    │   ├── InvalidGeometry      no surface, not finite, or out of range
    │   │   └── NothingVisible   there are triangles, but all have zero area, or none is in front of the camera
    │   └── InvalidOption        an option that is wrong by itself or does not fit the input
    ├── BackendUnavailable       the rendering backend that was asked for can't run on this machine
    ├── ModelError               the model that was asked for, or its input, is wrong
    │   ├── UnknownModel         no model of that name
    │   ├── UnsupportedScale     the model doesn't upscale by that factor
    │   ├── UnsuitedModel        a single-picture model was given views of a light field, or the other way round
    │   ├── UnsuitedProcessor    this machine's processor computes the int8 network wrongly
    │   ├── InvalidImage         not an array of pictures with the shape, type and range that models take
    │   └── BadCard              a card or its network is missing, incomplete or doesn't fit
    ├── BrokenNetwork            a network turned good input into something that is not a number
    ├── JobError                 a job of the service could not be taken or finished
    │   ├── QueueFull            the largest allowed number of jobs is already waiting
    │   ├── QueueUnavailable     the queue or the files can't be used
    │   │   └── NoRoom           the server's disk or memory is full
    │   ├── ResultExpired        the result or file was kept as long as allowed and then removed
    │   ├── WorkerDied           the worker process ended in the middle of its work
    │   │   └── TimedOut         it was ended because the job used up its time
    │   └── Cancelled            the work was stopped because the result is no longer wanted
    ├── NotReady                 the server is still loading its models, or it is stopping
    └── ServiceError             a server's answer can't be used (`ciir.service.client`)
        ├── ConnectionFailed     the server can't be reached, or the connection broke
        ├── Unauthorized         the API key is missing or wrong
        ├── NotFound             there is no such job or file
        └── NotDone              the job is still waiting or running
"""

from __future__ import annotations


def advise_extra(extra: str) -> str:
    """Returns the `pip` command for an extra of pyproject.toml, for messages; `ciir` is on no package index."""
    return f"pip install '.[{extra}]' in the folder of ciir's source code"


class Error(Exception):
    """The root of all errors of `ciir`; `str()` is one line with what was given, the limit and the remedy."""


class InputError(Error, ValueError):
    """The input or an option is wrong."""


class UnsupportedType(InputError):  # noqa: N818 - the cause is the name, here and below
    """The file's type is not read, or is not the one that its name says."""


class Unreadable(InputError):  # noqa: N818
    """The file is truncated, corrupt, or not decodable."""


class TooLarge(InputError):  # noqa: N818
    """The input is over a limit on bytes, pixels, files or triangles."""

    def __init__(self, message: str, limit: str = "", needed: int = 0) -> None:
        super().__init__(message)
        self.limit = limit
        """The name of the limit in `renderer.limits.Limits`; empty for a fixed one."""
        self.needed = needed
        """A value of that limit that would suffice; 0 if it isn't known."""


class InvalidGeometry(InputError):  # noqa: N818
    """The geometry has no surface, is not finite, or is out of range."""


class NothingVisible(InvalidGeometry):
    """All triangles have zero area, or none is in front of the camera; this may differ at another time."""


class InvalidOption(InputError):  # noqa: N818
    """An option is wrong by itself or does not fit the input."""


class BackendUnavailable(Error, RuntimeError):  # noqa: N818
    """The rendering backend that was asked for can't run on this machine."""


class ModelError(Error, ValueError):
    """The model that was asked for, or its input, is wrong."""


class UnknownModel(ModelError):  # noqa: N818
    """There is no model of that name."""


class UnsupportedScale(ModelError):  # noqa: N818
    """The model doesn't upscale by that factor."""


class UnsuitedModel(ModelError):  # noqa: N818
    """A single-picture model was given views of a light field, or the other way round."""


class UnsuitedProcessor(ModelError):  # noqa: N818
    """This machine's processor computes the int8 network wrongly, or isn't known to compute it correctly."""


class InvalidImage(ModelError):  # noqa: N818
    """The input is not an array of pictures with the shape, type and range that models take."""


class BadCard(ModelError):  # noqa: N818
    """A card or its network is missing, incomplete or doesn't fit."""


class BrokenNetwork(Error, RuntimeError):  # noqa: N818
    """A network turned good input into something that is not a number: its weights are wrong, not the picture."""


class JobError(Error):
    """A job of the service could not be taken or finished."""


class QueueFull(JobError):  # noqa: N818
    """The largest allowed number of jobs is already waiting: HTTP's 429."""

    def __init__(self, detail: str, retry_after: int = 1) -> None:
        super().__init__(detail)
        self.retry_after = retry_after
        """An estimate, in whole seconds."""

    def __reduce__(self) -> tuple[type[QueueFull], tuple[str, int]]:
        """Pickles `retry_after` too, which pickle would leave out."""
        return type(self), (str(self), self.retry_after)


class QueueUnavailable(JobError):  # noqa: N818
    """The queue or the files can't be used: HTTP's 503."""


class NoRoom(QueueUnavailable):
    """The server's disk or memory is full: HTTP's 503."""


class ResultExpired(JobError, LookupError):  # noqa: N818
    """The result, or a file that was sent, was kept as long as allowed and then removed: HTTP's 410.

    A new request makes the result again; a file has to be sent again.
    """


class WorkerDied(JobError):  # noqa: N818
    """The worker process was killed, or crashed, in the middle of its work."""

    def __init__(self, message: str, cause: str = "") -> None:
        super().__init__(message)
        self.cause = cause
        """Why, for the client, if it is known: follows "because"."""


class TimedOut(WorkerDied):
    """The worker process was ended in the middle of its work because the job used up its time."""


class Cancelled(JobError):  # noqa: N818
    """The work was stopped because the result is no longer wanted."""


class NotReady(Error, RuntimeError):  # noqa: N818
    """The server is still loading its models, or it is stopping."""


class ServiceError(Error):
    """A server's answer can't be used, and no other error fits it."""


class ConnectionFailed(ServiceError, ConnectionError):  # noqa: N818
    """The server can't be reached, or the connection broke."""


class Unauthorized(ServiceError):  # noqa: N818
    """The API key is missing or wrong: HTTP's 401."""


class NotFound(ServiceError, LookupError):  # noqa: N818
    """There is no such job: HTTP's 404."""


class NotDone(ServiceError):  # noqa: N818
    """The job is still waiting or running: HTTP's 409."""
