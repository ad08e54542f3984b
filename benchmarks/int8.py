"""How much faster each int8 twin runs than its float network, and what it costs.

    python -m benchmarks.int8 [--rounds 15] [--on FOLDER ...]

Both run in turns in one process, so that whatever slows the machine slows both; the ratio is the median over rounds of
float's time to int8's. One view of 200x200 pixels and one of 640x360, on one core and on all. Accuracy: Y-PSNR in dB on
the test sets, by the published protocol, the twin's minus the float network's.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from pathlib import Path

import numpy as np

from models import catalogue
from models.session import available_cores
from training.evaluate import evaluate

SIZES = ((200, 200), (360, 640))
SETS = tuple(Path("../shared/data/images") / name for name in ("Set5", "Set14", "BSD100"))


def main(argv: list[str] | None = None) -> int:
    """Prints a row for each twin, size and number of cores, and one for each test set."""
    parser = argparse.ArgumentParser(prog="benchmarks.int8", description=main.__doc__)
    parser.add_argument("--rounds", type=int, default=15, help="times that each is run (default 15)")
    parser.add_argument("--on", type=Path, nargs="*", default=SETS, help="test sets (default: Set5, Set14, BSD100)")
    given = parser.parse_args(argv)
    twins = [
        entry.card for entry in catalogue.entries() if entry.card and entry.card.float_twin and not entry.is_light_field
    ]
    for card in twins:
        for threads in sorted({1, available_cores()}):
            pair = [catalogue.load(name, threads=threads) for name in (card.float_twin, card.name)]
            for height, width in SIZES:
                image = np.random.default_rng(0).random((1, 3, height, width), dtype=np.float32)
                times: list[list[float]] = []
                for _ in range(given.rounds + 1):
                    round_of: list[float] = []
                    for network in pair:
                        begun = time.perf_counter()
                        network(image)
                        round_of.append(time.perf_counter() - begun)
                    times.append(round_of)
                plain, quick = (1e3 * statistics.median(column) for column in zip(*times[1:], strict=True))
                ratio = statistics.median(a / b for a, b in times[1:])
                sys.stdout.write(
                    f"{card.name:14s}{width}x{height}, {threads} core(s): float {plain:.1f} ms, int8 {quick:.1f} ms, "
                    f"{ratio:.2f} times faster\n"
                )
        for folder in given.on:
            scores = [evaluate(catalogue.load(name), folder).psnr for name in (card.float_twin, card.name)]
            change = scores[1] - scores[0]
            sys.stdout.write(f"{card.name:14s}{folder.name}: {scores[0]:.2f} -> {scores[1]:.2f} dB ({change:+.3f})\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
