"""Fuzzes the targets, one process after the other, and counts.

    python -m benchmarks.fuzz.run [TARGET ...] [--inputs 10000] [--seconds 300] [--folder runs/fuzz] [--seed 1]

Needs atheris (`pip install atheris`). Each line: target, inputs, how many of them were read and refused, seconds, and
the files with inputs on which the target broke its word (`benchmarks.fuzz.targets`). Exit status 1 where there are any.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fuzz.targets import TARGETS

MOST_ATTEMPTS = 5
"""Each finding ends the fuzzer; so often it is begun for one target."""
MOST_BYTES = 8192
"""Of one input."""
_FINDINGS = ("crash-", "leak-", "oom-", "timeout-")
"""What the names of libFuzzer's files of findings begin with."""


@dataclass(frozen=True)
class Tally:
    """What became of a target's inputs."""

    read: int
    refused: int
    findings: tuple[str, ...]

    @property
    def inputs(self) -> int:
        """All of them; those that are findings are counted by neither of the two."""
        return self.read + self.refused + len(self.findings)


def fuzz(name: str, folder: Path, *, inputs: int, seconds: int, seed: int) -> Tally:
    """The target called `name`, for at most `inputs` inputs and `seconds` seconds; begun again after each finding."""
    read = refused = 0
    folder.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + seconds
    before = set(folder.iterdir())
    found: list[Path] = []
    for attempt in range(MOST_ATTEMPTS):
        left, rest = int(end - time.monotonic()), inputs - read - refused - len(found)
        if left < 1 or rest < 1:
            break
        flags = [
            f"-runs={rest}",
            f"-max_total_time={left}",
            f"-seed={seed + attempt}",
            f"-max_len={MOST_BYTES}",
            "-len_control=0",
        ]
        command = [sys.executable, "-m", "benchmarks.fuzz.one", name, str(folder), *flags]
        with (folder / "log").open("ab") as log:
            status = subprocess.run(command, check=False, stdout=log, stderr=log).returncode
        counts = (folder / "counts").read_text().split() if (folder / "counts").exists() else []
        if not counts:
            raise RuntimeError(f"{name}: the fuzzer ended with status {status} on its seeds; {folder / 'log'} says why")
        read, refused = read + int(counts[0]), refused + int(counts[1])
        found = sorted(path for path in set(folder.iterdir()) - before if path.name.startswith(_FINDINGS))
        if status == 0:
            break
    return Tally(read, refused, tuple(map(str, found)))


def main(argv: list[str] | None = None) -> int:
    """Prints a line for each target, and the sum."""
    parser = argparse.ArgumentParser(prog="benchmarks.fuzz.run", description=main.__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"default: all of {', '.join(TARGETS)}")
    parser.add_argument("--inputs", type=int, default=10_000, help="most inputs for each target (default 10000)")
    parser.add_argument("--seconds", type=int, default=300, help="most seconds for each target (default 300)")
    parser.add_argument("--folder", type=Path, default=Path("runs/fuzz"), help="corpus, logs, findings (runs/fuzz)")
    parser.add_argument("--seed", type=int, default=1, help="of the fuzzer's random numbers (default 1)")
    given = parser.parse_args(argv)
    unknown = sorted(set(given.targets) - set(TARGETS))
    if unknown:
        parser.error(f"{', '.join(unknown)}: no such target; known are {', '.join(TARGETS)}")
    total = findings = 0
    for name in given.targets or TARGETS:
        begun = time.monotonic()
        tally = fuzz(name, given.folder / name, inputs=given.inputs, seconds=given.seconds, seed=given.seed)
        total, findings = total + tally.inputs, findings + len(tally.findings)
        sys.stdout.write(
            f"{name:14s} {tally.inputs:9,} inputs: {tally.read:9,} read, {tally.refused:9,} refused, "
            f"{time.monotonic() - begun:6.0f} s, {len(tally.findings)} findings {' '.join(tally.findings)}\n"
        )
        sys.stdout.flush()
    sys.stdout.write(f"{'in all':14s} {total:9,} inputs, {findings} findings\n")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
