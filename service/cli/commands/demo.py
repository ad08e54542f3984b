"""`ciir demo`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.writers.atomic_write import Staged
from ciir.service.cli import common, output_path
from ciir.service.demo import demo

if TYPE_CHECKING:
    import argparse


def run(args: argparse.Namespace) -> None:
    """Writes the pictures, and prints where the time went."""
    options = common.options(args)
    staged = Staged(output_path.folder(args.out, what="the demo's pictures"))
    names: list[str] = []

    def write(name: str, data: bytes) -> None:
        staged.write(name, data)
        names.append(name)

    def tell(step: demo.Step) -> None:
        common.say(demo.line(step))

    common.say(demo.header())
    try:
        demo.run(write, options.backend, tell)
        staged.commit()
    finally:
        staged.discard()
    *of_one, sheet = names
    common.say(f"{args.out}: {', '.join(of_one)} of the {demo.SCENES[-1]}; {sheet} of all scenes")
