"""`ciir train` and `ciir export`: run `training`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.service.cli import common, output_path
from ciir.service.errors import join_lines

if TYPE_CHECKING:
    import argparse


def run(args: argparse.Namespace) -> None:
    """Runs the command `args.command`."""
    {"train": _train, "export": _export}[args.command](args)


def _train(args: argparse.Namespace) -> None:
    from ciir.training import recipe

    given = {name: value for name in recipe.OVERRIDES if (value := getattr(args, name)) is not None}
    try:
        read = recipe.read_recipe(Path(args.recipe), given)
    except ValueError as error:
        raise InvalidOption(str(error)) from error
    to = output_path.resolve_folder(args.out, what="a run")
    from ciir.training.loop.interrupt import Stopped
    from ciir.training.loop.train import train

    try:
        checkpoint = train(read, to)
    except (ValueError, FloatingPointError) as error:  # from folders and checkpoints, which only the loop reads
        raise InvalidOption(str(error)) from error
    except Stopped as stop:
        print(f"ciir: {join_lines(str(stop))}", file=sys.stderr)
        raise SystemExit(128 + stop.number) from None  # as shells report a signal
    common.print_line(f"{checkpoint}: done; next: ciir export {checkpoint} -o DIR")


def _export(args: argparse.Namespace) -> None:
    _check_export(args)
    source = Path(args.weights or args.checkpoint)
    if not source.is_file():
        what = "the weights" if args.weights else "the checkpoint.pt that `ciir train` wrote"
        raise InvalidOption(f"{source}: no such file; give {what}")
    to = output_path.resolve_folder(args.out, what="a network and its card")
    folders, calibrate = common.find_folders(args.on), common.find_folders(args.calibrate, what="pictures")
    given: dict[str, Any] = {"name": args.name or "", "accuracy_on": folders, "degradation": args.degradation}
    from ciir.training.export import export

    common.print_line(f"exporting {source}: half a minute, and longer with --int8 or --on")
    try:
        if source.suffix.lower() == ".onnx":
            from ciir.training.export.onnx_file import export_onnx

            card = export_onnx(source, to, **given)
        elif args.weights:
            from ciir.training.export.external_weights import export_weights

            card = export_weights(source, to, **given)
        elif args.int8:
            card = export.export_int8(source, to, calibrate=calibrate, **given)
        else:
            card = export.export_network(source, to, **given)
    except ValueError as error:
        raise InvalidOption(str(error)) from error
    common.print_line(f"{card.with_suffix('.onnx')} and {card}: written")


def _check_export(args: argparse.Namespace) -> None:
    if (args.weights is None) == (args.checkpoint is None):
        raise InvalidOption(
            "export: give a CHECKPOINT of `ciir train`, an ONNX file, or --weights with a file from elsewhere; "
            "one of them"
        )
    if args.int8 and (args.weights or args.checkpoint.lower().endswith(".onnx")):
        raise InvalidOption("--int8: only a CHECKPOINT of `ciir train` has an int8 twin; leave it out")
    if args.degradation and not args.on:
        raise InvalidOption("--degradation: this goes with --on; leave it out")
    if args.int8 != bool(args.calibrate):
        raise InvalidOption("--int8 needs --calibrate with a folder of pictures, and vice versa; give both or neither")
