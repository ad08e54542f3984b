"""The commands and options of the command line, with their help."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from typing import TYPE_CHECKING, NoReturn

from ciir.errors import InvalidOption
from ciir.models.catalogue import LIGHT_FIELD_DEFAULT
from ciir.service.cli.picture_arguments import add_batch, add_options, add_pictures
from ciir.service.pipeline.options import NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from _typeshed import SupportsWrite

KEPT = (
    "Finished jobs are kept in the folder CIIR_FOLDER (default: service in the cache folder), with their inputs and "
    "results unless CIIR_FILES names another place. The same request again gets the result that is kept. A result is "
    "removed CIIR_KEEP_SECONDS after its last request, and the longest unused earlier where all together exceed "
    "CIIR_KEEP_BYTES. These are environment variables; --show-settings describes them."
)
_OPTIONS = frozenset(f"--{name}" for name in NAMES)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, like all others."""

    def error(self, message: str) -> NoReturn:
        """Raises `InvalidOption` in place of printing the usage."""
        raise InvalidOption(f"{message}; see {self.prog} --help")

    def print_help(self, file: SupportsWrite[str] | None = None) -> None:
        """Raises `OSError` where the output can't be written, which argparse ignores."""
        (file or sys.stdout).write(self.format_help())
        sys.stdout.flush()


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    """Parses the command line. Raises `InvalidOption` where it is wrong."""
    whole = make_parser()
    args, rest = whole.parse_known_args(_join_values(argv))
    # Before Python 3.12.7 argparse takes no words of `evaluate` after an option.
    if args.command == "evaluate" and not any(word.startswith("-") for word in rest):
        args.words += rest
    elif rest:
        parser = whole if args.command is None else args.parser
        known = re.findall(r"--[\w-]+", parser.format_usage())
        close = difflib.get_close_matches(rest[0].partition("=")[0], known, n=1, cutoff=0.75)
        remedy = f"{close[0]} may be meant" if close else f"see {parser.prog} --help"
        raise InvalidOption(f"unrecognized arguments: {' '.join(rest)}; {remedy}")
    return args


def make_parser() -> argparse.ArgumentParser:
    """The parser. Each command sets `module`, the module of `service.cli.commands` that runs it."""
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
    _add_training(add_command)
    return top


def _add_models(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("models", "list the models")
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
    command.add_argument("--port", default="8000", help="port to listen on, 0 for a free one (default 8000)")
    command.add_argument("--show-settings", action="store_true", help="show all settings (CIIR_...) and exit")

    add_command("worker", "run worker processes for a `ciir serve` on another machine (CIIR_QUEUE, CIIR_FILES)")


def _add_measurements(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("bench", "measure run time against error for every method, with tables and pictures")
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
        help="arrays of N x N lenses in front of a mesh; with --harm also RxC, the lenses of an EIA picture",
    )
    command.add_argument("--rounds", metavar="N", help="how often each job runs (default 11, with --quick 3)")
    command.add_argument(
        "--quick", action="store_true", help="one scene, two lens arrays: a few minutes; with --harm a few seconds"
    )
    command.add_argument(
        "--harm",
        action="store_true",
        help="instead: where the default is worse than bicubic interpolation, or than the networks of single pictures, "
        "over meshes and light fields in many conditions; writes harm.json, harm.md and harm.png, and exits with 1 "
        "where it is by more than 0.1 dB",
    )
    command.add_argument("--only", choices=("meshes", "light-fields"), help="with --harm: one kind of input")
    command.add_argument(
        "--model",
        metavar="NAME",
        help="with --harm: judge this model in place of the default: one that `ciir models` lists, or an exported "
        "network's .json",
    )
    add_options(command, ("pixels", "pickup"))

    command = add_command("stress", "measure the numerics under stress against their bounds")
    command.add_argument("--quick", action="store_true", help="a few sizes and rounds: half a minute")
    command.add_argument(
        "--only", nargs="+", default=[], metavar="GROUP", help="groups of cases, named as in docs/numerics.md"
    )
    command.add_argument("--model", nargs="+", default=[], metavar="NAME", help="networks (default: all)")
    command.add_argument("--json", metavar="FILE", help="write all results to this file, too")


def _add_training(add_command: Callable[..., argparse.ArgumentParser]) -> None:
    command = add_command("evaluate", "measure a model's accuracy on pictures or on a light field", "training")
    command.add_argument(
        "words",
        nargs="*",
        metavar="MODEL FOLDER",
        help="a model that `ciir models` lists, or an exported network's .json; then folders of *_LR.png and *_HR.png "
        "pairs, or of any pictures with --degradation; with --light-field no folder, any number of models, and "
        f"{LIGHT_FIELD_DEFAULT} where none is named",
    )
    command.add_argument(
        "--degradation",
        choices=("bicubic", "box", "point"),
        default="",
        help="how LR is made of *_HR.png, of other pictures or of views (default for views: bicubic)",
    )
    command.add_argument(
        "--jpeg",
        type=int,
        metavar="QUALITY",
        help="with --light-field: LR views are those of an elemental image array in a JPEG of this quality, 1 to 100",
    )
    command.add_argument(
        "--light-field", metavar="INPUT", help="a light field instead of pictures: a folder of views, or any other"
    )
    command.add_argument(
        "--grid", metavar="KvxKu", help="how many views in the middle of the light field (default 5x5)"
    )
    command.add_argument(
        "--json", metavar="FILE", help="write the scores to this file, those of each view of a light field too"
    )
    add_options(command, ("scale",), "upscale")
    add_options(command, ("lenses", "pixels"))

    command = add_command("train", "train a network from a recipe", "training")
    command.add_argument(
        "recipe", metavar="RECIPE", help="a .toml file; some ship with the package, in training/recipes"
    )
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for the checkpoint and the log")
    for name, metavar, text in (
        ("name", "NAME", "the network's name"),
        ("train", "FOLDER", "training pictures, or VOC2012 as it unpacks"),
        ("validate", "FOLDER", "validation pairs, or pictures"),
        ("initial", "CHECKPOINT", "weights to start from"),
        ("vgg", "FILE", "torchvision's VGG-19 weights"),
        ("device", "D", "cpu, cuda or auto"),
    ):
        command.add_argument(f"--{name}", metavar=metavar, help=f"{text}; replaces the recipe's")
    command.add_argument("--steps", metavar="N", type=int, help="optimiser steps; replaces the recipe's")

    command = add_command("export", "export a checkpoint, or a network of others, to .onnx with its card", "training")
    command.add_argument(
        "checkpoint", metavar="CHECKPOINT", nargs="?", help="checkpoint.pt of `ciir train`, or any network as .onnx"
    )
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for NAME.onnx and NAME.json")
    command.add_argument(
        "--int8", action="store_true", help="export the int8 twin, NAME-int8, for processors with VNNI"
    )
    command.add_argument(
        "--calibrate", nargs="+", default=[], metavar="FOLDER", help="pictures that give the int8 twin its ranges"
    )
    command.add_argument("--weights", metavar="FILE", help="weights that spandrel knows, instead of a checkpoint")
    command.add_argument("--name", metavar="NAME", help="the network's name (default: the recipe's, or the file's)")
    command.add_argument("--on", nargs="*", default=[], metavar="FOLDER", help="test sets whose scores go on the card")


def _join_values(argv: Sequence[str]) -> list[str]:
    """`--lenses -5x5` as `--lenses=-5x5`, so that the error names the option that has the wrong value."""
    joined: list[str] = []
    for word in argv:
        if joined and joined[-1] in _OPTIONS and re.match("-[^-oh]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined
