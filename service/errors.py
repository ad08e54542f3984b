"""One table that maps classes of errors to exit statuses of the command line and status codes of HTTP."""

from __future__ import annotations

from dataclasses import dataclass

from ciir import errors


@dataclass(frozen=True)
class ErrorResponse:
    """How errors of one class are reported."""

    status: int
    """HTTP status code."""
    exit: int
    """Exit status: 2 for an error in the input or an option, 1 for anything else."""
    title: str
    """A phrase that is the same for all errors of the class (RFC 9457)."""


CANCELLED = "Cancelled"
"""The title of the problem if the result of a cancelled job is asked for."""
_TABLE: tuple[tuple[type[errors.Error], ErrorResponse], ...] = (  # the first row whose class fits is used
    (errors.TooLarge, ErrorResponse(413, 2, "Over a limit")),
    (errors.UnsupportedType, ErrorResponse(415, 2, "Type not supported")),
    (errors.Unreadable, ErrorResponse(422, 2, "Not readable")),
    (errors.InvalidGeometry, ErrorResponse(422, 2, "Invalid geometry")),
    (errors.InvalidOption, ErrorResponse(422, 2, "Invalid option")),
    (errors.InputError, ErrorResponse(422, 2, "Invalid input")),
    (errors.BackendUnavailable, ErrorResponse(503, 2, "Backend not available")),
    (errors.BadCard, ErrorResponse(500, 1, "Model broken")),
    (errors.ModelError, ErrorResponse(422, 2, "Invalid model or scale")),
    (errors.BrokenNetwork, ErrorResponse(500, 1, "Model broken")),
    (errors.QueueFull, ErrorResponse(429, 1, "Queue full")),
    (errors.NoRoom, ErrorResponse(503, 1, "No room")),
    (errors.QueueUnavailable, ErrorResponse(503, 1, "Not available")),
    (errors.ResultExpired, ErrorResponse(410, 1, "Expired")),
    (errors.JobError, ErrorResponse(503, 1, "Job not finished")),
    (errors.NotReady, ErrorResponse(503, 1, "Not ready")),
    (errors.Error, ErrorResponse(500, 1, "Error")),
)


def find_response(error: errors.Error) -> ErrorResponse:
    """Returns the first row of the table that fits `error`."""
    return next(row for kind, row in _TABLE if isinstance(error, kind))


def find_class(title: str) -> type[errors.Error] | None:
    """Returns the class of errors that `title` reports, or None for a problem of HTTP itself."""
    if title == CANCELLED:
        return errors.Cancelled
    return next((kind for kind, row in _TABLE if row.title == title and kind is not errors.Error), None)


def join_lines(text: str) -> str:
    """Replaces each run of white space with one space, so that a message with any file name in it is one line."""
    return " ".join(text.split())
