"""Runs the command line, `ciir` or `python -m ciir`. Ctrl-C ends it cleanly, even while its modules are imported."""

from __future__ import annotations

import gc
import os
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType


def main() -> int:
    """Runs the command with the arguments of this process and returns the exit status."""
    is_usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # background commands ignore SIGINT
    if is_usual:
        signal.signal(signal.SIGINT, _end)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's matrices here are small: more threads only wait
    gc.disable()
    from ciir.service.cli.main import main as run

    gc.freeze()  # modules last as long as the process
    gc.enable()
    if is_usual:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return run()
    finally:
        gc.freeze()  # or the process's end would look for cycles among all objects, which takes 20 to 50 ms


def _end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature is Python's
    """Ends the process at once, because modules such as numpy's turn a `KeyboardInterrupt` into other errors."""
    print("ciir: interrupted", file=sys.stderr, flush=True)
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
