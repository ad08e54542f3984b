"""Parses the command line, runs the command, and reports errors in one line.

Exit status: 0 done; 2 the input or an option is wrong; 3 some inputs of a batch failed; 1 anything else; 130 after
Ctrl-C; 143 after SIGTERM; 141 if the program that reads the output has ended.
"""

from __future__ import annotations

import errno
import importlib
import os
import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ciir.errors import Error, InvalidOption, TooLarge
from ciir.service.cli.extras import require_extra
from ciir.service.cli.messages import format_message
from ciir.service.cli.parser import parse_arguments
from ciir.service.errors import find_response, join_lines
from ciir.service.pipeline.limits import describe_setting

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from types import FrameType

INTERRUPTED = 130
TERMINATED = 143
PIPE_CLOSED = 141
NO_SPACE, NO_PLACE = 1, 2
PLACE = dict.fromkeys(
    (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO), (NO_SPACE, "make room there, or name another place")
) | dict.fromkeys(
    (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG),
    (NO_PLACE, "name a place that can be read or written"),
)
"""Errors of the operating system when reading or writing a place -> exit status and remedy."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs `argv` (by default the process's own) and returns the exit status. Errors are one line on stderr."""
    given = sys.argv[1:] if argv is None else argv
    try:
        _run(given)
    except Error as error:
        more = describe_setting(error) if isinstance(error, TooLarge) else ""
        return _print_error(format_message(f"{error}{more}", given[1:]), find_response(error).exit)
    except BrokenPipeError:
        _discard_output()
        return PIPE_CLOSED
    except OSError as error:
        if error.errno not in PLACE:
            raise
        status, remedy = PLACE[error.errno]
        if status == NO_SPACE:
            _discard_output()
        return _print_error(f"{error.filename or 'the output'}: {error.strerror}; {remedy}", status)
    except KeyboardInterrupt:
        return _print_error("interrupted", INTERRUPTED)
    except _Terminated:
        return _print_error("terminated", TERMINATED)
    return 0


def _run(argv: Sequence[str]) -> None:
    args = parse_arguments(argv)
    if args.version:
        from importlib.metadata import version

        print(f"ciir {version('ciir')}")
    elif args.command is None:
        raise InvalidOption("no command given; see ciir --help")
    else:
        with _terminable(args.command), require_extra(args.command):
            importlib.import_module(f"ciir.service.cli.commands.{args.module}").run(args)
    sys.stdout.flush()


class _Terminated(BaseException):
    """SIGTERM was received."""


@contextmanager
def _terminable(command: str) -> Iterator[None]:
    """Raises an exception in the block on SIGTERM, so that no partial output stays.

    Servers handle SIGTERM themselves.
    """
    if command in ("serve", "worker"):
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature is Python's
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second SIGTERM must not stop the clean-up
        raise _Terminated

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _discard_output() -> None:
    """Redirects stdout to the null device, so that Python's flush on exit does no harm."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_error(error: Exception | str, status: int) -> int:
    print(f"ciir: {join_lines(str(error))}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
