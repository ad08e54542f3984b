"""`ciir bench`: runs `benchmarks.bench`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.scenes import SCENES
from ciir.service.cli import common, output_path
from ciir.service.pipeline.source import SCENE, open_source

if TYPE_CHECKING:
    import argparse

    from ciir.benchmarks.bench.run import BenchOptions
    from ciir.service.pipeline.source import Source


def run(args: argparse.Namespace) -> None:
    """Measures, writes the results, and prints where they are."""
    to = output_path.resolve_folder(args.out, what="the results")
    if to.is_file():
        raise InvalidOption(f"-o: {to} is a file; name a folder for the results")
    options = _parse(args)
    from ciir.benchmarks.bench.run import bench

    found = bench(options, to)
    common.print_line(
        f"{to}: results.md, results.csv, results.json, pareto.png, crops.png written after {found['seconds']:.0f} s"
    )
    for where, names in found["frontier"].items():
        common.print_line(f"{where}: best for its time: {', '.join(names)}")


def _parse(args: argparse.Namespace) -> BenchOptions:
    from ciir.benchmarks.bench.run import QUICK, BenchOptions

    options = QUICK if args.quick else BenchOptions()
    if args.inputs:
        sources: dict[str, Source] = {_name(text): open_source(text) for text in args.inputs}
        if len(sources) < len(args.inputs):
            raise InvalidOption("bench: two inputs have the same name; rename one, or give one of them")
        options = replace(options, sources=sources)
    if args.lenses:
        options = replace(options, lenses=_counts("--lenses", args.lenses, 2, 1000))
    if args.rounds is not None:
        options = replace(options, rounds=_counts("--rounds", [args.rounds], 1, 1000)[0])
    return replace(options, array=common.parse_options(args))


def _name(text: str) -> str:
    if not text.startswith(SCENE):
        return Path(text).resolve().stem
    name = text.removeprefix(SCENE)
    if name not in SCENES:
        raise InvalidOption(f"{text[:40]}: no such scene; the scenes are {', '.join(SCENES)}")
    return name


def _counts(option: str, texts: list[str], least: int, most: int) -> tuple[int, ...]:
    for text in texts:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise InvalidOption(
                f"{option}: {text[:40]!r} is no whole number from {least} to {most}; give one such as 50"
            )
    return tuple(int(text) for text in texts)
