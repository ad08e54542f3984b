"""One target under atheris, which learns from what our own code does with each input what to try next.

    python -m tests.fuzz.one TARGET FOLDER [-runs=N] [-max_total_time=SECONDS] [other flags of libFuzzer]

`FOLDER` gets `corpus/`, the seeds and what was found to go new ways; `counts`, how many inputs were read and how many
refused; and at the first input on which the target breaks its word, opens a file or a connection, or takes over 10
seconds, that input as `crash-...`, `oom-...` or `timeout-...`. `tests.fuzz.run` calls this for all targets.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import atheris

OURS = [
    "ciir.renderer",
    "ciir.service.pipeline.run",
    "ciir.service.pipeline.planning.plan",
    "ciir.service.pipeline.options",
    "ciir.service.web",
]
with atheris.instrument_imports(include=OURS):
    from ciir.renderer import readers
    from tests.fuzz.guard import Guard
    from tests.fuzz.targets import TARGETS, BrokenPromise

SECONDS_EACH, MEBIBYTES = 10, 3000


def main() -> None:
    """Never returns: libFuzzer ends the process."""
    target, folder = TARGETS[sys.argv[1]], Path(sys.argv[2])
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    with atheris.instrument_imports(include=OURS):  # readers are imported when they are first used: now
        for module in walk_packages(readers.__path__, f"{readers.__name__}."):
            import_module(module.name)
        for number, seed in enumerate(target.seeds()):
            (corpus / f"seed-{number}").write_bytes(seed)
            target(seed)
    counts = os.open(folder / "counts", os.O_CREAT | os.O_RDWR | os.O_TRUNC, 0o644)
    was_read = refused = 0
    guard = Guard()

    def check(data: bytes) -> None:
        nonlocal was_read, refused
        guard.arm()
        if target(data):
            was_read += 1
        else:
            refused += 1
        guard.disarm()
        os.pwrite(counts, f"{was_read} {refused}\n".encode(), 0)  # libFuzzer ends without a word to Python
        if guard.seen:
            raise BrokenPromise("; ".join(guard.seen))

    flags = [f"-timeout={SECONDS_EACH}", f"-rss_limit_mb={MEBIBYTES}", f"-artifact_prefix={folder}/"]
    atheris.Setup([sys.argv[0], *flags, *sys.argv[3:], str(corpus)], check)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
