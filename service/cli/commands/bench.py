"""`ciir bench`: runs `benchmarks.bench`, and with `--harm` `benchmarks.harm`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.renderer.scenes import SCENES
from ciir.service.cli import common, output_path
from ciir.service.pipeline.options import read_pair
from ciir.service.pipeline.source import SCENE, open_source

if TYPE_CHECKING:
    import argparse

    from ciir.benchmarks.bench.run import BenchOptions
    from ciir.benchmarks.harm.run import HarmOptions
    from ciir.service.pipeline.source import Source

OVER = 1
"""Exit status if a case of the harm table exceeds its bound."""


def run(args: argparse.Namespace) -> None:
    """Measures, writes the results, and prints where they are. Exits with `OVER` if the default does harm."""
    to = output_path.resolve_folder(args.out, what="the results")
    if to.is_file():
        raise InvalidOption(f"-o: {to} is a file; name a folder for the results")
    if args.harm:
        _run_harm(_parse_harm(args), to)
        return
    for name in ("only", "model"):
        if getattr(args, name) is not None:
            raise InvalidOption(f"--{name}: this is for the harm table; give --harm too, or leave it out")
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
        options = replace(options, sources=_open_sources(args.inputs))
    if args.lenses:
        options = replace(options, lenses=_counts("--lenses", args.lenses, least=2))
    if args.rounds is not None:
        options = replace(options, rounds=_counts("--rounds", [args.rounds], least=1)[0])
    return replace(options, array=common.parse_options(args))


def _run_harm(options: HarmOptions, to: Path) -> None:
    from ciir.benchmarks.harm.run import measure_harm

    found = measure_harm(options, to)
    common.print_line(f"{to}: harm.json, harm.md, harm.png written after {found['seconds']:.0f} s")
    for line in found["lines"]:
        common.print_line(line)
    common.print_line(f"{found['over']} of {found['cases']} cases are over the bound of {found['bound']} dB")
    if found["over"]:
        raise SystemExit(OVER)


def _parse_harm(args: argparse.Namespace) -> HarmOptions:
    """Parses the options of the harm table.

    In `--lenses`, whole numbers are for meshes, and rows x columns for elemental image arrays.
    """
    from ciir.benchmarks.harm.case import LIGHT_FIELD, MESH, PICTURE
    from ciir.benchmarks.harm.run import HarmOptions

    if args.rounds is not None:
        raise InvalidOption("--rounds: the harm table measures no times; leave it out")
    options = HarmOptions(sources=_open_sources(args.inputs), quick=args.quick)
    pairs = [text for text in args.lenses if "x" in text.lower()]
    if len(pairs) > 1:
        raise InvalidOption(f"--lenses: {pairs[0]} and {pairs[1]} are both for elemental image arrays; give one")
    array = common.parse_options(args)
    if pairs:
        array = replace(array, lenses=read_pair("--lenses", pairs[0]))
    if counts := [text for text in args.lenses if text not in pairs]:
        options = replace(options, lenses=_counts("--lenses", counts, least=8))  # SSIM needs 11 pixels of truth
    if args.only is not None:
        kinds = {"meshes": MESH, "light-fields": LIGHT_FIELD, "pictures": PICTURE}
        options = replace(options, kinds=(kinds[args.only],))
    return replace(options, array=array, model=args.model or options.model)


def _open_sources(texts: list[str]) -> dict[str, Source]:
    sources: dict[str, Source] = {_name(text): open_source(text) for text in texts}
    if len(sources) < len(texts):
        raise InvalidOption("bench: two inputs have the same name; rename one, or give one of them")
    return sources


def _name(text: str) -> str:
    if not text.startswith(SCENE):
        return Path(text).resolve().stem
    name = text.removeprefix(SCENE)
    if name not in SCENES:
        raise InvalidOption(f"{text[:40]}: no such scene; the scenes are {', '.join(SCENES)}")
    return name


def _counts(option: str, texts: list[str], *, least: int) -> tuple[int, ...]:
    return tuple(common.read_count(option, text, least, 1000, example=50) for text in texts)
