"""What each fault means to a caller: an exit status for the command line and a status code for HTTP, in one table."""

from __future__ import annotations

from dataclasses import dataclass

from ciir.errors import (
    BackendUnavailable,
    BadCard,
    BrokenNetwork,
    InputError,
    InvalidGeometry,
    InvalidOption,
    ModelError,
    NotReady,
    TooLarge,
    Unreadable,
    UnsupportedType,
)


@dataclass(frozen=True)
class Meaning:
    """How one class of faults is told."""

    status: int
    """HTTP status code."""
    exit: int
    """Exit status: 2 the input or an option is at fault, 1 anything else."""
    title: str
    """A few words that are the same for every fault of the class (RFC 9457)."""


_TABLE: tuple[tuple[type[Exception], Meaning], ...] = (  # the first row that fits counts
    (TooLarge, Meaning(413, 2, "Over a limit")),
    (UnsupportedType, Meaning(415, 2, "Type not supported")),
    (Unreadable, Meaning(422, 2, "Not readable")),
    (InvalidGeometry, Meaning(422, 2, "Invalid geometry")),
    (InvalidOption, Meaning(422, 2, "Invalid option")),
    (InputError, Meaning(422, 2, "Invalid input")),
    (BackendUnavailable, Meaning(422, 2, "Backend not available")),
    (BadCard, Meaning(500, 1, "Model broken")),
    (BrokenNetwork, Meaning(500, 1, "Model broken")),
    (ModelError, Meaning(422, 2, "Invalid model or scale")),
    (NotReady, Meaning(503, 1, "Not ready")),
)
FAULTS = (InputError, BackendUnavailable, BrokenNetwork, ModelError, NotReady)
"""The classes that cover the table: what to catch."""


def meaning(fault: Exception) -> Meaning:
    """The row of the table for `fault`; raises `LookupError` for an exception that is none of `FAULTS`."""
    for kind, row in _TABLE:
        if isinstance(fault, kind):
            return row
    raise LookupError(f"{type(fault).__name__} is not a fault that callers are told about")


def one_line(text: str) -> str:
    """`text` with every run of white space as one space: a message stays one line whatever a file name holds."""
    return " ".join(text.split())
