"""What a process of its own pays beside the work: the start of OpenGL, of the first network, and whole `ciir` commands.

    python -m benchmarks.cold opengl|network        # in this process, which must not have started it: milliseconds

`benchmarks.planning` runs it, in processes of their own, and holds `service.cost`'s typical starts against it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

KINDS = ("opengl", "network")


def main(argv: list[str] | None = None) -> int:
    """Prints by how many milliseconds of processor time the first call of a kind takes longer than the second."""
    given = sys.argv[1:] if argv is None else argv
    if len(given) != 1 or given[0] not in KINDS:
        sys.stderr.write(f"benchmarks.cold: {' '.join(given)!r} is not known; give {' or '.join(KINDS)}\n")
        return 2
    from renderer.scenes import scene

    scene("vase")  # made once a process, whatever draws it
    job = {"opengl": _view, "network": _upscaled}[given[0]]
    first, second = _taken(job, time.process_time), _taken(job, time.process_time)
    sys.stdout.write(f"{first - second:.1f}\n")
    return 0


def start(kind: str, rounds: int) -> float:
    """Milliseconds of processor time that the start of one of `KINDS` takes a process, the least of `rounds` of them.

    Nearly all of it is in one thread, so that it takes as long where nobody else has the core.
    """
    command = [sys.executable, "-m", "benchmarks.cold", kind]
    return min(float(_output(command)) for _ in range(rounds))


def reconstruction(options: Sequence[str]) -> float:
    """Milliseconds on the wall of a whole process of `ciir reconstruct`, from its start to its end."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "service.cli", "reconstruct", *options, "-o", str(Path(folder) / "out.zip")]
        return _taken(lambda: _output(command), time.perf_counter)


def _taken(job: Callable[[], Any], clock: Callable[[], float]) -> float:
    begun = clock()
    job()
    return 1000 * (clock() - begun)


def _output(command: list[str]) -> str:
    """Raises `CalledProcessError` where it fails."""
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def _view() -> None:
    from renderer.backends import open_backend
    from renderer.framing import frame
    from renderer.lens_array import LensArray
    from renderer.scenes import scene

    array, vase = LensArray(20, 20, 3, 3, 1.0, 0.1), scene("vase")
    next(iter(open_backend("raster")[0].views(vase.transformed(frame(vase, array)), array, [(1, 1)])))


def _upscaled() -> None:
    from models import catalogue

    catalogue.load(catalogue.default())(np.zeros((1, 3, 20, 20), np.float32))


if __name__ == "__main__":
    sys.exit(main())
