"""Fuzzes the targets, each in a process of its own, and counts.

    python -m tests.fuzz.run [TARGET ...] [--inputs 10000] [--seconds 300] [--folder runs/fuzz] [--seed 1]

Needs atheris (`pip install atheris`). Each line: target, inputs that were read and refused, and the file with the input
at which the target broke its promise (`tests.fuzz.targets`), which ends it. Exit status 1 where there is one.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from tests.fuzz.targets import TARGETS

MOST_BYTES = 8192
"""Of one input."""
_FINDINGS = ("crash-", "leak-", "oom-", "timeout-")
"""Prefixes of libFuzzer's files of findings."""


def fuzz(name: str, folder: Path, *, inputs: int, seconds: int, seed: int) -> tuple[int, int, list[Path]]:
    """Inputs of the target `name` that were read and refused, and its findings."""
    folder.mkdir(parents=True, exist_ok=True)
    before = set(folder.iterdir())
    flags = [f"-runs={inputs}", f"-max_total_time={seconds}", f"-seed={seed}", f"-max_len={MOST_BYTES}"]
    command = [sys.executable, "-m", "tests.fuzz.one", name, str(folder), *flags, "-len_control=0"]
    with (folder / "log").open("wb") as log:
        status = subprocess.run(command, check=False, stdout=log, stderr=log).returncode  # noqa: S603 - our own
    counts = (folder / "counts").read_text().split() if (folder / "counts").exists() else []
    if not counts:
        raise RuntimeError(f"{name}: the fuzzer ended with status {status} on its seeds; see {folder / 'log'}")
    found = [path for path in set(folder.iterdir()) - before if path.name.startswith(_FINDINGS)]
    return int(counts[0]), int(counts[1]), found


def main() -> int:
    """Prints a line for each target."""
    parser = argparse.ArgumentParser(prog="tests.fuzz.run", description=main.__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"default: all of {', '.join(TARGETS)}")
    parser.add_argument("--inputs", type=int, default=10_000, help="most inputs for each target (default 10000)")
    parser.add_argument("--seconds", type=int, default=300, help="most seconds for each target (default 300)")
    parser.add_argument("--folder", type=Path, default=Path("runs/fuzz"), help="corpus, logs, findings (runs/fuzz)")
    parser.add_argument("--seed", type=int, default=1, help="of the fuzzer's random numbers (default 1)")
    given = parser.parse_args()
    findings = []
    for name in given.targets or TARGETS:
        read, refused, found = fuzz(
            name, given.folder / name, inputs=given.inputs, seconds=given.seconds, seed=given.seed
        )
        findings += found
        print(f"{name:14s} {read:9,} read, {refused:9,} refused  {' '.join(map(str, found))}", flush=True)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
