"""The commands and options of the command line, with their help."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from typing import TYPE_CHECKING, NoReturn

from ciir.errors import InvalidOption
from ciir.models.catalogue import LIGHT_FIELD_DEFAULT
from ciir.service.cli.picture_arguments import READING_VIEWS, add_batch, add_options, add_pictures
from ciir.service.pipeline.options import NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from _typeshed import SupportsWrite

KEPT = (
    "Finished jobs are kept in the folder CIIR_FOLDER (default: service in the cache folder). Their inputs and "
    "results are kept there too, unless CIIR_FILES names another place. Sending the same request again returns the "
    "kept result. A result is removed CIIR_KEEP_SECONDS after its last request; if all results together exceed "
    "CIIR_KEEP_BYTES, the least recently used are removed earlier. These are environment variables; --show-settings "
    "describes them."
)
_OPTIONS = frozenset(f"--{name}" for name in NAMES)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, like all others."""

    def error(self, message: str) -> NoReturn:
        """Raises `InvalidOption` instead of printing the usage."""
        found = re.fullmatch(r"argument .*: invalid choice: '(.*)' \(choose from (.*)\)", message)
        close = _advise(found[1], re.findall(r"[\w-]+", found[2])) if found is not None else ""
        raise InvalidOption(f"{message}; {close or f'see {self.prog} --help'}")

    def print_help(self, file: SupportsWrite[str] | None = None) -> None:
        """Prints the help. Raises `OSError` if the output can't be written, which argparse ignores."""
        (file or sys.stdout).write(self.format_help())
        sys.stdout.flush()


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    """Parses the command line. Raises `InvalidOption` if it is wrong."""
    whole = make_parser()
    args, rest = whole.parse_known_args(_join_values(argv))
    # Before Python 3.12.7 argparse accepts no words of `evaluate` after an option.
    if args.command == "evaluate" and not any(word.startswith("-") for word in rest):
        args.words += rest
    elif rest:
        parser = whole if args.command is None else args.parser
        known = re.findall(r"--[\w-]+", parser.format_usage())
        remedy = _advise(rest[0].partition("=")[0], known) or f"see {parser.prog} --help"
        if re.fullmatch(r"\d+,\d+;?", rest[0]):
            remedy = "several views are one word, as in --views '0,0 7,7'"
        raise InvalidOption(f"unrecognized arguments: {' '.join(rest)}; {remedy}")
    return args


def make_parser() -> argparse.ArgumentParser:
    """Makes the parser. Each command sets `module`, the module in `service.cli.commands` that runs it."""
    top = Parser(
        prog="ciir", description="Reconstructs views of light fields from meshes and pictures, and upscales them."
    )
    top.add_argument("--version", action="store_true", help="show the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    def add_command(name: str, text: str, module: str | None = None, more: str = "") -> argparse.ArgumentParser:
        description = f"{text[0].upper()}{text[1:]}. {more}".rstrip()
        added = commands.add_parser(name, help=text, description=description, allow_abbrev=False)
        added.set_defaults(module=module or name, parser=added)
        return added

    add_pictures(add_command)
    add_batch(add_command)
    _add_models(add_command)
    _add_service(add_command)
    _add_measurements(add_command)
    _add_evaluate(add_command)
    _add_train(add_command)
    _add_export(add_command)
    return top


def _add_models(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("models", "list the networks and interpolations")
    command.add_argument("--json", action="store_true", help="list everything about each model, as JSON")

    command = add_command(
        "demo", "make pictures of the shipped scenes, from mesh to upscaled views, with timings and accuracy"
    )
    command.add_argument(
        "-o", "--out", default="demo-out", metavar="DIR", help="folder for the pictures (default demo-out)"
    )
    add_options(command, ("backend",))


def _add_service(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("serve", "serve the HTTP API", more=KEPT)
    command.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default 127.0.0.1: this machine only)"
    )
    command.add_argument("--port", default="8000", help="port to listen on; 0 chooses a free one (default 8000)")
    command.add_argument("--show-settings", action="store_true", help="show all settings (CIIR_...) and exit")

    add_command("worker", "run worker processes for a `ciir serve` on another machine (CIIR_QUEUE, CIIR_FILES)")


def _add_measurements(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("bench", "measure the run time and error of every method, with tables and pictures")
    command.add_argument(
        "inputs",
        metavar="INPUT",
        nargs="*",
        help="meshes, EIA pictures, folders of views (default: the shipped scenes)",
    )
    command.add_argument(
        "-o", "--out", default="bench-out", metavar="DIR", help="folder for the results (default bench-out)"
    )
    command.add_argument(
        "--lenses",
        nargs="+",
        default=[],
        metavar="N",
        help="use arrays of N x N lenses for meshes; with --harm also RxC, the lenses of an EIA picture",
    )
    command.add_argument("--rounds", metavar="N", help="how many times each job runs (default 11, or 3 with --quick)")
    command.add_argument(
        "--quick",
        action="store_true",
        help="one scene and two lens arrays: takes a few minutes, with --harm a few seconds",
    )
    command.add_argument(
        "--harm",
        action="store_true",
        help="instead, find where the default is worse than bicubic interpolation or than the single-picture networks, "
        "over meshes, light fields and pictures in many conditions; write harm.json, harm.md and harm.png, and exit "
        "with 1 if it is worse by more than 0.1 dB",
    )
    command.add_argument(
        "--only",
        choices=("meshes", "light-fields", "pictures"),
        help="with --harm: measure only this kind of input",
    )
    command.add_argument(
        "--model",
        metavar="NAME",
        help="with --harm: judge this model instead of the default: a name that `ciir models` lists, or the .json of "
        "an exported network",
    )
    add_options(command, ("pixels", "pickup"))

    command = add_command("stress", "measure numerical errors under stress and compare them with their bounds")
    command.add_argument("--quick", action="store_true", help="a few sizes and rounds: takes half a minute")
    command.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="GROUP",
        help="groups of cases to run, named as in docs/numerics.md (default: all)",
    )
    command.add_argument("--model", nargs="+", default=[], metavar="NAME", help="networks to run (default: all)")
    command.add_argument("--json", metavar="FILE", help="also write all results to this file")


def _add_evaluate(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("evaluate", "measure the accuracy of a model, or of results against their truth")
    command.add_argument(
        "words",
        nargs="*",
        metavar="MODEL FOLDER",
        help="models that `ciir models` lists, or the .json of exported networks; then folders of *_LR.png and "
        "*_HR.png pairs, or of any pictures with --degradation. With --light-field: only models (default "
        f"{LIGHT_FIELD_DEFAULT}). With --truth: results",
    )
    command.add_argument(
        "--truth",
        metavar="INPUT",
        help="compare results with this, of the same size: a picture, a light field, a folder of pictures with the "
        "same names, or a disparity map (.pfm, .npy, .tif, .png, as `ciir depth` writes them)",
    )
    command.add_argument(
        "--degradation",
        choices=("bicubic", "box", "point"),
        default="",
        help="how LR pictures are made from *_HR.png, other pictures or views (default for views: bicubic); with point "
        "the truth is the mean of each 2x2 pixels, at half the size",
    )
    command.add_argument(
        "--jpeg",
        type=int,
        metavar="QUALITY",
        help="with --light-field: take LR views from an elemental image array in a JPEG of this quality, 1 to 100",
    )
    command.add_argument(
        "--light-field",
        metavar="INPUT",
        help="a light field to use instead of pictures: a folder of views, or any other",
    )
    command.add_argument(
        "--network-only",
        action="store_true",
        help="with --light-field: score a network's own output, as the log of `ciir train` does, without the fallback "
        "and the corrections that follow it in `ciir reconstruct`",
    )
    command.add_argument(
        "--grid", metavar="KvxKu", help="use this many views in the middle of the light field (default 5x5)"
    )
    command.add_argument(
        "--json", metavar="FILE", help="write the scores to this file, with those of each picture or view"
    )
    add_options(command, ("scale",), "upscale")
    add_options(command, (*READING_VIEWS, "fusion"))


def _add_train(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("train", "train a network from a recipe", "training")
    command.add_argument(
        "recipe", metavar="RECIPE", help="a .toml file; some ship with the package, in training/recipes"
    )
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for the checkpoint and the log")
    for name, metavar, text in (
        ("name", "NAME", "the network's name"),
        ("train", "FOLDER", "training pictures, or VOC2012 as unpacked"),
        ("validate", "FOLDER", "validation pairs, or pictures"),
        ("initial", "CHECKPOINT", "weights to start from"),
        ("vgg", "FILE", "torchvision's VGG-19 weights"),
        ("device", "D", "cpu, cuda or auto"),
    ):
        command.add_argument(f"--{name}", metavar=metavar, help=f"{text}; replaces the recipe's")
    command.add_argument("--steps", metavar="N", type=int, help="optimiser steps; replaces the recipe's")


def _add_export(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command(
        "export", "export a checkpoint, or a network from elsewhere, to .onnx with its card", "training"
    )
    command.add_argument(
        "checkpoint",
        metavar="CHECKPOINT",
        nargs="?",
        help="checkpoint.pt written by `ciir train`, or any network as .onnx",
    )
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for NAME.onnx and NAME.json")
    command.add_argument(
        "--int8", action="store_true", help="export the int8 twin, NAME-int8, for processors with VNNI"
    )
    command.add_argument(
        "--calibrate",
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="pictures from which the int8 twin's ranges are measured",
    )
    command.add_argument("--weights", metavar="FILE", help="weights that spandrel supports, instead of a checkpoint")
    command.add_argument("--name", metavar="NAME", help="the network's name (default: from the recipe or the file)")
    command.add_argument("--on", nargs="*", default=[], metavar="FOLDER", help="test sets whose scores go on the card")
    command.add_argument(
        "--degradation",
        choices=("bicubic", "box", "point"),
        default="",
        help="how LR is made from the pictures of --on (default: from *_LR.png; of views in all three ways)",
    )


def _advise(word: str, known: Sequence[str]) -> str:
    """Asks about the word of `known` that is closest to a misspelt one; empty if none is close."""
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.75)
    return f"did you mean {close[0]}?" if close else ""


def _join_values(argv: Sequence[str]) -> list[str]:
    """Joins `--lenses -5x5` to `--lenses=-5x5`, so that the error names the option that has the wrong value."""
    joined: list[str] = []
    for word in argv:
        if joined and joined[-1] in _OPTIONS and re.match("-[^-oh]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined
