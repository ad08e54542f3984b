"""`ciir demo`: makes pictures of the shipped scenes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.writers.atomic_write import Staged
from ciir.service.cli import common, output_path
from ciir.service.demo import demo

if TYPE_CHECKING:
    import argparse


def run(args: argparse.Namespace) -> None:
    """Writes the pictures, and prints where the time went and how good the views are."""
    options = common.parse_options(args)
    staged = Staged(output_path.resolve_folder(args.out, what="the demo's pictures"))
    names: list[str] = []

    def write(name: str, data: bytes) -> None:
        staged.write(name, data)
        names.append(name)

    def print_step(step: demo.Step) -> None:
        common.print_line(demo.format_step(step))

    common.print_line(demo.format_header())
    try:
        rows = demo.run_demo(write, options.backend, print_step)
        staged.commit()
    finally:
        staged.discard()
    for row in rows:
        common.print_line(demo.format_result(row))
    *single, sheet = names
    common.print_line(f"{args.out}: {', '.join(single)} of the {demo.SCENES[-1]}; {sheet} of all scenes")
