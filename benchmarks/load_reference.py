"""An answer of the server held against what `ciir reconstruct` makes of the same file and options."""

from __future__ import annotations

import contextlib
import io
import zipfile
from typing import TYPE_CHECKING

from benchmarks.load_client import LATER
from benchmarks.load_requests import asked
from service import cli

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def differences(numbers: Sequence[int], answers: Path, folder: Path) -> list[str]:
    """Of each of the requests `numbers` whose answer differs from the command line's a line that says how.

    `answers` holds `NUMBER-STATUS` with the body; `folder` is for what is made here. Runs in a process of its own.
    """
    return [line for number in numbers if (line := _difference(number, answers, folder))]


def _difference(number: int, answers: Path, folder: Path) -> str:
    given = asked(number)
    (answer,) = answers.glob(f"{number}-*")
    status = int(answer.name.partition("-")[2])
    file, out = folder / f"{number}-{given.name}", folder / str(number)
    file.write_bytes(given.data)
    options = [word for name, value in given.options.items() for word in (f"--{name}", value)]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        ended = cli.main(["reconstruct", str(file), "-o", str(out), *options])
    file.unlink()
    what = f"request {number}, {given.kind} {given.name}"
    if ended != 0:
        is_refused = ended == 2 and 400 <= status < 500 and status not in LATER
        return "" if is_refused else f"{what}: answered {status}, the command line ends with {ended}: {said.getvalue()}"
    if status != 200:
        return f"{what}: answered {status}, the command line makes it: {answer.read_bytes()[:300]!r}"
    made = {path.name: path.read_bytes() for path in out.glob("*.png")}
    for path in out.iterdir():
        path.unlink()
    got = _pictures(answer.read_bytes())
    if len(made) == 1 and len(got) == 1:
        return "" if list(made.values()) == list(got.values()) else f"{what}: another picture"
    wrong = sorted(name for name in made.keys() | got.keys() if made.get(name) != got.get(name))
    return f"{what}: {len(wrong)} of {len(made)} views differ, {wrong[0]} first" if wrong else ""


def _pictures(body: bytes) -> dict[str, bytes]:
    """An answer's pictures by name: those of a zip, or the one that it is."""
    if not body.startswith(b"PK"):
        return {"": body}
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.endswith(".png")}
