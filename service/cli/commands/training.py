"""`ciir evaluate`, `ciir train` and `ciir export`: run `training`."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ciir.errors import InvalidOption
from ciir.models.catalogue import LIGHT_FIELD_DEFAULT, list_names
from ciir.renderer.writers.atomic_write import place_for_file, replacing
from ciir.renderer.writers.writer import report_json
from ciir.service.cli import common, output_path
from ciir.service.errors import join_lines
from ciir.service.pipeline.options import Options, read_pair
from ciir.service.pipeline.source import make_layout

if TYPE_CHECKING:
    import argparse

    from ciir.models.cards import Accuracy

VIEWS, DEGRADATION = "5x5", "bicubic"
"""The defaults for evaluating a light field, from BasicLFSR's protocol."""
OVERRIDES = ("name", "train", "validate", "initial", "vgg", "steps", "device")
"""Fields of a recipe that can also be given as options."""


def run(args: argparse.Namespace) -> None:
    """Runs the command `args.command`."""
    {"evaluate": _evaluate, "train": _train, "export": _export}[args.command](args)


def _evaluate(args: argparse.Namespace) -> None:
    options, names = common.parse_options(args), list(args.words)
    if args.json is not None:
        place_for_file(Path(args.json))
    if args.light_field is not None:
        _evaluate_views(args, options)
        return
    for name, given in (
        ("grid", args.grid),
        ("jpeg", args.jpeg),
        ("lenses", options.lenses),
        ("pixels", options.pixels),
        ("fusion", None if options.fusion == Options.fusion else options.fusion),
    ):
        if given is not None:
            raise InvalidOption(f"--{name}: this goes with --light-field; leave it out")
    if len(names) < 2:
        raise InvalidOption(
            "evaluate: give a MODEL and FOLDERs of pictures, or --light-field INPUT; see ciir evaluate --help"
        )
    for name in names[1:]:
        if Path(name).is_file():
            raise InvalidOption(
                f"{name}: a file, but a folder of pictures is needed; for a light field give --light-field {name}"
            )
    from ciir.training.evaluation.pictures import describe_protocol, evaluate

    entries: list[dict[str, Any]] = []
    for folder in _folders(names[1:]):
        try:
            score = evaluate(names[0], folder, scale=options.scale, degradation=args.degradation)
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        entries.append(_show_score(names[0], score, "pictures", args.degradation or None))
    _write_scores(describe_protocol(args.degradation), options.scale, entries, args.json)


def _evaluate_views(args: argparse.Namespace, options: Options) -> None:
    names = args.words or [LIGHT_FIELD_DEFAULT]
    for name in names:
        if name not in list_names() and Path(name).is_dir():
            raise InvalidOption(
                f"evaluate: both the folder {name!r} and --light-field {args.light_field} are given; give one of them"
            )
    if args.jpeg is not None and not 1 <= args.jpeg <= 100:
        raise InvalidOption(f"--jpeg: {args.jpeg} is out of range; give 1 to 100")
    grid, degradation = read_pair("grid", args.grid or VIEWS), args.degradation or DEGRADATION
    from ciir.training.evaluation.light_fields import describe_protocol, load_network, measure

    networks = [load_network(name, options.scale) for name in names]  # finds a misspelt name before the work starts
    entries: list[dict[str, Any]] = []
    for name, network in zip(names, networks, strict=True):
        try:
            found = measure(
                network,
                Path(args.light_field),
                grid=grid,
                degradation=degradation,
                layout=make_layout(options),
                jpeg=args.jpeg,
                fusion=options.fusion,
            )
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        views = [{"v": v, "u": u, "psnr": _finite(psnr), "ssim": ssim} for (v, u), (psnr, ssim) in found.views.items()]
        entries.append(_show_score(name, found.mean, "views", degradation) | {"views": views})
    _write_scores(describe_protocol(grid), options.scale, entries, args.json)


def _show_score(model: str, score: Accuracy, counted: str, degradation: str | None) -> dict[str, Any]:
    """Prints the line for a score, and returns the score for JSON."""
    common.print_line(
        f"{model} on {score.data}: PSNR {score.psnr:.2f} dB, SSIM {score.ssim:.4f} on Y over {score.pictures} {counted}"
    )
    return {
        "model": model,
        "data": score.data,
        "degradation": degradation,
        "count": score.pictures,
        "psnr": _finite(score.psnr),
        "ssim": score.ssim,
    }


def _finite(psnr: float) -> float | None:
    """Returns `psnr`, or None for infinity, which JSON can't represent."""
    return psnr if math.isfinite(psnr) else None


def _write_scores(protocol: str, scale: int, entries: list[dict[str, Any]], path: str | None) -> None:
    if path is not None:
        with replacing(Path(path)) as file:
            file.write(report_json({"protocol": protocol, "scale": scale, "scores": entries}))


def _train(args: argparse.Namespace) -> None:
    from ciir.training import recipe

    given = {name: value for name in OVERRIDES if (value := getattr(args, name)) is not None}
    try:
        read = replace(recipe.read_recipe(Path(args.recipe)), **given)
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
    name = args.name or ""
    folders, calibrate = _folders(args.on), _folders(args.calibrate, what="pictures")
    from ciir.training.export import export

    common.print_line(f"exporting {source}: half a minute, and longer with --int8 or --on")
    try:
        if source.suffix.lower() == ".onnx":
            from ciir.training.export.onnx_file import export_onnx

            card = export_onnx(source, to, name=name, accuracy_on=folders)
        elif args.weights:
            from ciir.training.export.external_weights import export_weights

            card = export_weights(source, to, name=name, accuracy_on=folders)
        elif args.int8:
            card = export.export_int8(source, to, calibrate=calibrate, name=name, accuracy_on=folders)
        else:
            card = export.export_network(source, to, name=name, accuracy_on=folders)
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
    if args.int8 != bool(args.calibrate):
        raise InvalidOption("--int8 needs --calibrate with a folder of pictures, and vice versa; give both or neither")


def _folders(
    names: list[str], *, what: str = "*_LR.png and *_HR.png pairs, or of views for a light-field network"
) -> list[Path]:
    folders = [Path(name) for name in names]
    for folder in folders:
        if not folder.is_dir():
            raise InvalidOption(f"{folder}: no such folder; give one of {what}")
    return folders
