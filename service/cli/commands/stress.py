"""`ciir stress`: runs `benchmarks.stress`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import place_for_file, replacing
from ciir.service.cli import common

if TYPE_CHECKING:
    import argparse

BROKEN = 1
"""Exit status if a bound does not hold."""


def run(args: argparse.Namespace) -> None:
    """Measures and prints, and writes the JSON file if one is named. Exits with `BROKEN` if a bound does not hold."""
    if args.json is not None:
        if not args.json:
            raise InvalidOption("--json: '' is not a name; name a file for the results")
        place_for_file(Path(args.json))  # checked before minutes of work
    from ciir.benchmarks.stress import run as stress
    from ciir.benchmarks.stress.case import Effort

    groups = stress.select_groups(args.only)
    models, unsuited = stress.select_models(args.model)
    found = stress.stress(groups, Effort(models, quick=args.quick), write=common.print_line, skipped=unsuited)
    if args.json is not None:
        with replacing(Path(args.json)) as file:
            file.write((json.dumps(found, indent=2, allow_nan=False) + "\n").encode())
    if found["broken"]:
        raise SystemExit(BROKEN)
