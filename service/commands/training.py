"""`ciir evaluate`, `ciir train` and `ciir export`: the doors to `training`, whose packages need not be installed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from renderer.errors import InvalidOption
from service.commands import common, out

if TYPE_CHECKING:
    import argparse

EXTRA = ("torch", "onnx", "onnxscript", "onnx_ir")
"""What the extra `training` brings."""


def run(args: argparse.Namespace) -> None:
    """Does the command; a missing package and a fault in a recipe or a folder are one line."""
    work = {"evaluate": _evaluate, "train": _train, "export": _export}[args.command]
    try:
        work(args)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in EXTRA:
            raise
        raise InvalidOption(
            f"{args.command}: the package {error.name} is not installed; run `make setup-training`"
        ) from error


def _evaluate(args: argparse.Namespace) -> None:
    options = common.options(args)
    from training.evaluate import evaluate_folder

    for folder in _folders(args.folders):
        try:
            score = evaluate_folder(args.model, folder, scale=options.scale)
        except ValueError as error:
            raise InvalidOption(str(error)) from error
        common.say(f"{score.data}: PSNR {score.psnr:.2f} dB, SSIM {score.ssim:.4f} on Y over {score.pictures} pictures")


def _train(args: argparse.Namespace) -> None:
    from training import recipe

    try:
        read = recipe.read(Path(args.recipe))
    except ValueError as error:
        raise InvalidOption(str(error)) from error
    to = out.folder(args.out, what="a run")
    from training.loop import train

    common.say(f"training {read.name}: {read.steps} steps; stop and start again at any time")
    try:
        checkpoint = train(read, to)
    except (ValueError, FloatingPointError) as error:  # folders and checkpoints, which only the loop looks into
        raise InvalidOption(str(error)) from error
    common.say(f"{checkpoint}: done; next: ciir export {checkpoint} -o DIR")


def _export(args: argparse.Namespace) -> None:
    checkpoint = Path(args.checkpoint)
    if not checkpoint.is_file():
        raise InvalidOption(f"{checkpoint}: no such file; give the checkpoint.pt that `ciir train` wrote")
    to = out.folder(args.out, what="a network and its card")
    from training.export import export

    folders = _folders(args.on)
    try:
        card = export(checkpoint, to, accuracy_on=folders)
    except ValueError as error:
        raise InvalidOption(str(error)) from error
    common.say(f"{card.with_suffix('.onnx')} and {card}: written")


def _folders(names: list[str]) -> list[Path]:
    folders = [Path(name) for name in names]
    for folder in folders:
        if not folder.is_dir():
            raise InvalidOption(f"{folder}: no such folder; give one of *_LR.png and *_HR.png pairs")
    return folders
