"""The command line, `ciir`: what can be asked for, and what a fault looks like.

Exit status: 0 done; 2 the input or an option is at fault, with one line on standard error; 1 anything else;
130 after Ctrl-C, 143 after SIGTERM; 141 where whoever read our output went away.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import re
import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn

from ciir.errors import Error, InvalidOption
from ciir.models.catalogue import DEFAULT, LIGHT_FIELD_DEFAULT
from ciir.service.cli.extras import require_extra
from ciir.service.errors import find_response, join_lines
from ciir.service.pipeline.options import HELP, NAMES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from types import FrameType

    from _typeshed import SupportsWrite

INTERRUPTED = 130
TERMINATED = 143
PIPE_CLOSED = 141
NO_ROOM, NO_PLACE = 1, 2
PLACE = dict.fromkeys(
    (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO), (NO_ROOM, "make room there, or name another place")
) | dict.fromkeys(
    (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG),
    (NO_PLACE, "name a place that can be read or written"),
)
"""System errors that are about where is read or written -> exit status and remedy."""

_OPTIONS = frozenset(f"--{name}" for name in NAMES)
KEPT = (
    "Finished jobs are kept in the folder CIIR_FOLDER (default: service in the cache folder), with their inputs and "
    "results unless CIIR_FILES names another place. The same request again gets the result that is kept. A result is "
    "removed CIIR_KEEP_SECONDS after its last request, and the longest unused earlier where all together exceed "
    "CIIR_KEEP_BYTES. These are environment variables; --show-settings describes them."
)
ELEMENTAL = ("lenses", "pixels", "backend", "sampling", "pickup", "background", "pitch", "delta")


class Parser(argparse.ArgumentParser):
    """A parser whose faults are one line, as all others are."""

    def error(self, message: str) -> NoReturn:
        """Raises `InvalidOption` in place of printing the usage."""
        raise InvalidOption(f"{message}; see {self.prog} --help")

    def print_help(self, file: SupportsWrite[str] | None = None) -> None:
        """Raises `OSError` where argparse keeps quiet of it."""
        (file or sys.stdout).write(self.format_help())
        sys.stdout.flush()


def _add_options(parser: argparse.ArgumentParser, names: Sequence[str], **texts: str) -> None:
    """Options of `service.pipeline.options`; `texts`: help in place of what stands there."""
    for name in names:
        metavar, text = HELP[name][0], texts.get(name, HELP[name][1])
        parser.add_argument(
            f"--{name.replace('_', '-')}", metavar=metavar, help=text, default=argparse.SUPPRESS, dest=f"option_{name}"
        )


def parser() -> argparse.ArgumentParser:
    """The whole command line. Each command's `run` names the module of `service.cli.commands` that does it."""
    top = Parser(prog="ciir", description="Views of a light field: from a mesh or an elemental image array, upscaled.")
    top.add_argument("--version", action="store_true", help="show the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    def command(name: str, text: str, module: str | None = None, more: str = "") -> argparse.ArgumentParser:
        description = f"{text[0].upper()}{text[1:]}. {more}".rstrip()
        added = commands.add_parser(name, help=text, description=description, allow_abbrev=False)
        added.set_defaults(module=module or name)
        return added

    add = command("reconstruct", "views out of a mesh, an EIA picture, or a folder or zip of views")
    add.add_argument("input", metavar="INPUT", help="file, folder or zip, or scene:vase, scene:globe, scene:hamburger")
    add.add_argument(
        "-o", "--out", required=True, metavar="OUT", help="a folder; or a file name with .zip, .npz or .png"
    )
    _add_options(add, NAMES)
    add.add_argument("--report", metavar="FILE", help="write the report (JSON) here too")

    add = command("elemental", "a mesh's elemental image array")
    add.add_argument("input", metavar="MESH", help="mesh file, or zip or folder with one, or scene:NAME")
    add.add_argument("-o", "--out", required=True, metavar="FILE", help="picture to write: .png, .tif or .jpg")
    _add_options(add, ELEMENTAL)
    add.add_argument("--report", metavar="FILE", help="write the report (JSON) here")

    add = command("upscale", "any picture, or a folder of them, upscaled")
    add.add_argument("input", metavar="IMAGE_OR_FOLDER", help="PNG, TIFF or JPEG; 8 or 16 bit; grey, RGB, alpha")
    add.add_argument("-o", "--out", required=True, metavar="OUT", help="a picture's name, or a folder")
    takes = f"a listed model that takes pictures (default {DEFAULT}, or its int8 twin where the processor suits)"
    _add_options(add, ("model", "scale", "skip"), model=takes)
    add.add_argument("--report", metavar="FILE", help="write the report (JSON) here")

    add = command("models", "the models that can be named")
    add.add_argument("--json", action="store_true", help="all that is known of each, as JSON")

    add = command("demo", "the shipped scenes from mesh to upscaled view, as pictures and a table of timings")
    add.add_argument(
        "-o", "--out", default="demo-out", metavar="DIR", help="folder for the pictures (default demo-out)"
    )
    _add_options(add, ("backend",))

    add = command("serve", "the HTTP API", more=KEPT)
    add.add_argument("--host", default="127.0.0.1", help="address to listen on (default 127.0.0.1: this machine only)")
    add.add_argument("--port", default="8000", help="port to listen on, 0 for a free one (default 8000)")
    add.add_argument("--show-settings", action="store_true", help="show all settings (CIIR_...) as they are and exit")

    command("worker", "worker processes alone, for jobs that `ciir serve` takes in elsewhere (CIIR_QUEUE, CIIR_FILES)")

    add = command("bench", "run time against error, by every method, as tables and pictures")
    add.add_argument(
        "inputs", metavar="INPUT", nargs="*", help="meshes, EIA pictures, folders of views (default: scenes)"
    )
    add.add_argument(
        "-o", "--out", default="bench-out", metavar="DIR", help="folder for the results (default bench-out)"
    )
    add.add_argument("--lenses", nargs="+", default=[], metavar="N", help="of arrays N x N in front of a mesh")
    add.add_argument("--rounds", metavar="N", help="times that each job is run (default 11, with --quick 3)")
    add.add_argument("--only-views", action="store_true", help="leave out EIAs, inference engines and growth")
    add.add_argument("--quick", action="store_true", help="one scene, two lens arrays: a few minutes")
    _add_options(add, ("pixels", "pickup"))

    add = command("stress", "the numerics under stress: what was bounded, the bound, and what was measured")
    add.add_argument("--quick", action="store_true", help="a few sizes and rounds in place of all: half a minute")
    add.add_argument(
        "--only", nargs="+", default=[], metavar="GROUP", help="groups of cases, as docs/numerics.md has them"
    )
    add.add_argument("--model", nargs="+", default=[], metavar="NAME", help="networks (default: all that are shipped)")
    add.add_argument("--json", metavar="FILE", help="write all results here too")

    _add_training(command)
    return top


def _add_training(command: Callable[..., argparse.ArgumentParser]) -> None:
    """The commands of `service.cli.commands.training`."""
    add = command("evaluate", "a model's accuracy on folders of *_LR.png and *_HR.png pairs, or on views", "training")
    add.add_argument(
        "words",
        nargs="*",
        metavar="MODEL FOLDER",
        help="a name that `ciir models` lists, or an exported network's .json; then folders of pairs, or of any "
        f"pictures with --degradation, or none with --light-field (and the model {LIGHT_FIELD_DEFAULT} where none is "
        "named)",
    )
    add.add_argument(
        "--degradation",
        choices=("bicubic", "box", "point"),
        default="",
        help="make LR this way out of the folder's *_HR.png, or of any pictures where it has none, or of views "
        "(default for views: bicubic)",
    )
    add.add_argument("--light-field", metavar="FOLDER", help="views of a light field, in place of pictures")
    add.add_argument("--grid", metavar="KvxKu", help="how many views in the middle of the light field (default 5x5)")
    _add_options(add, ("scale",))

    add = command("train", "a network, from a recipe", "training")
    add.add_argument("recipe", metavar="RECIPE", help="a .toml file as in training/recipes")
    add.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for the checkpoint and the log")
    add.add_argument("--name", metavar="NAME", help="in place of the recipe's: the network's name")
    add.add_argument("--train", metavar="FOLDER", help="in place of the recipe's: pictures, or VOC2012 as it unpacks")
    add.add_argument("--validate", metavar="FOLDER", help="in place of the recipe's: pairs, or pictures")
    add.add_argument("--initial", metavar="CHECKPOINT", help="in place of the recipe's: weights to start from")
    add.add_argument("--vgg", metavar="FILE", help="in place of the recipe's: torchvision's VGG-19 weights")
    add.add_argument("--steps", metavar="N", type=int, help="in place of the recipe's: optimiser steps")
    add.add_argument("--device", metavar="D", help="in place of the recipe's: cpu, cuda or auto")

    add = command("export", "a checkpoint, or a network that others trained, to .onnx and card", "training")
    add.add_argument("checkpoint", metavar="CHECKPOINT", nargs="?", help="checkpoint.pt as `ciir train` writes it")
    add.add_argument("-o", "--out", required=True, metavar="DIR", help="folder for NAME.onnx and NAME.json")
    add.add_argument("--int8", action="store_true", help="the network's int8 twin, NAME-int8, for processors with VNNI")
    add.add_argument(
        "--calibrate", nargs="+", default=[], metavar="FOLDER", help="pictures that show the int8 twin its ranges"
    )
    add.add_argument("--weights", metavar="FILE", help="in place of a checkpoint: weights that spandrel knows")
    add.add_argument("--name", metavar="NAME", help="the network's name (default: the recipe's, or the file's)")
    add.add_argument("--on", nargs="*", default=[], metavar="FOLDER", help="test sets whose scores go on the card")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs `argv` (the process's own where None) and returns the exit status. Faults are one line on stderr."""
    try:
        _run(sys.argv[1:] if argv is None else argv)
    except Error as error:
        return _tell(error, find_response(error).exit)
    except BrokenPipeError:
        _forget_output()
        return PIPE_CLOSED
    except OSError as fault:
        if fault.errno not in PLACE:
            raise
        status, remedy = PLACE[fault.errno]
        if status == NO_ROOM:
            _forget_output()
        return _tell(f"{fault.filename or 'the output'}: {fault.strerror}; {remedy}", status)
    except KeyboardInterrupt:
        return _tell("interrupted", INTERRUPTED)
    except _Terminated:
        return _tell("terminated", TERMINATED)
    return 0


def _run(argv: Sequence[str]) -> None:
    args = _parsed(_joined(argv))
    if args.version:
        from importlib.metadata import version

        print(f"ciir {version('ciir')}")
    elif args.command is None:
        raise InvalidOption("no command given; see ciir --help")
    else:
        with _terminable(args.command), require_extra(args.command):
            importlib.import_module(f"ciir.service.cli.commands.{args.module}").run(args)
    sys.stdout.flush()


def _parsed(argv: Sequence[str]) -> argparse.Namespace:
    """What was asked for; before Python 3.12.7 argparse takes no words of `evaluate` from behind an option."""
    whole = parser()
    args, rest = whole.parse_known_args(argv)
    if args.command == "evaluate" and not any(word.startswith("-") for word in rest):
        args.words += rest
    elif rest:
        whole.error(f"unrecognized arguments: {' '.join(rest)}")
    return args


def _joined(argv: Sequence[str]) -> list[str]:
    """`--lenses -5x5` as `--lenses=-5x5`: argparse takes the second word for an option, and would not name it."""
    joined: list[str] = []
    for word in argv:
        if joined and joined[-1] in _OPTIONS and re.match("-[^-oh]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


class _Terminated(BaseException):
    """SIGTERM came."""


@contextmanager
def _terminable(command: str) -> Iterator[None]:
    """SIGTERM ends the block as an exception, so that nothing half-written stays. Servers have their own way to end."""
    if command in ("serve", "worker"):
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature is Python's
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: what cleans up is not to be broken off
        raise _Terminated

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _forget_output() -> None:
    """Python flushes stdout once more on its way out: let that go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _tell(fault: Exception | str, status: int) -> int:
    print(f"ciir: {join_lines(str(fault))}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
