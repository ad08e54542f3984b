"""A reconstruction as one file: made now or, where the same was asked for before, taken out of the store.

The key is a hash of all that the result depends on: the input's bytes, the options, the form of the output and this
installation, that is its code, its networks (whose cards hold their SHA-256) and the versions of its packages. What was
read beside the input, textures for example, is listed with the result and held against what is there now.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from models import processor
from renderer.bundle import Bundle
from renderer.errors import InputError
from service import cost, pipeline
from service.outputs import REPORT, FileSink
from service.report import Clock, Report, to_json

if TYPE_CHECKING:
    from service.pipeline import Progress
    from service.request import Options
    from service.source import Source
    from service.store import Store, Stored

MEMORY_BYTES = 8 << 20
"""An answer up to this size stays in memory; a larger one goes through a temporary file."""
_PACKAGES = ("ciir", "numpy", "onnxruntime", "embreex", "pyrender", "pillow", "imagecodecs", "tifffile", "DracoPy")
_CODE = ("renderer", "models", "service")
_SUFFIXES = (".py", ".json", ".frag", ".vert")
_LISTED, _THERE = "/", "there"
"""What was noted of a folder's names, and of a file that was looked for and not read; no file is called `/`."""


@dataclass(frozen=True)
class Answer:
    """A finished reconstruction; `file` stands at its beginning and is the caller's to close."""

    file: IO[bytes]
    size: int
    format: str
    report: Report
    """With a stage `stored` in `timings_ms` where the result was there already."""
    trouble: str = ""
    """Why the store could not be used, in words; empty where it could, or where there is none."""


def answer(
    source: Source,
    options: Options,
    form: str | None,
    *,
    store: Store | None = None,
    max_pixels: int | None = None,
    progress: Progress | None = None,
) -> Answer:
    """What `pipeline.reconstruct` makes, as a file of the format `form` (see `FileSink`); raises as it does.

    Out of `store` it is the same to the byte but for the report's `timings_ms`.
    """
    if store is None:
        return _made(source, options, form, max_pixels, progress)
    clock = Clock()
    noted = NotedFiles(source.files) if isinstance(source, Bundle) else NotedFiles({})
    if isinstance(source, Bundle):
        source = replace(source, files=noted)
    key = _key(source, options, form, max_pixels)
    trouble, found = "", None
    try:
        with clock.stage("stored"):
            found = _found(store, key, noted)
    except OSError as error:
        trouble = f"the store can't be read ({error})"
    if found is not None:
        return _again(found, clock, progress)
    made = _made(source, options, form, max_pixels, progress)
    try:
        store.put(key, {"format": made.format, "report": made.report, "read": noted.seen}, made.file)
    except (OSError, InputError) as error:
        trouble = f"the result can't be stored ({error})"
        made.file.seek(0)
    return Answer(made.file, made.size, made.format, made.report, trouble)


class NotedFiles(Mapping[str, bytes]):
    """A bundle's files, with a note of all that was asked of them."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files
        self.seen: dict[str, str | None] = {}
        """Name -> SHA-256 of what was read, `there` of what was only looked for, None of what isn't there; `/` -> that
        of all names."""

    def __getitem__(self, key: str) -> bytes:
        try:
            data = self._files[key]
        except KeyError:
            self.seen[key] = None
            raise
        self.seen[key] = hashlib.sha256(data).hexdigest()
        return data

    def __contains__(self, key: object) -> bool:
        is_there = key in self._files
        self.seen.setdefault(str(key), _THERE if is_there else None)
        return is_there

    def __iter__(self) -> Iterator[str]:
        names = list(self._files)
        self.seen[_LISTED] = _hash_of_names(names)
        return iter(names)

    def __len__(self) -> int:
        return len(self._files)

    def agree(self, seen: Mapping[str, str | None]) -> bool:
        """Whether all that was noted once is so now."""
        return all(self._state(name, state) == state for name, state in seen.items())

    def _state(self, name: str, before: str | None) -> str | None:
        if name == _LISTED:
            return _hash_of_names(list(self._files))
        if name not in self._files:
            return None
        return _THERE if before == _THERE else hashlib.sha256(self._files[name]).hexdigest()


def _made(
    source: Source, options: Options, form: str | None, max_pixels: int | None, progress: Progress | None
) -> Answer:
    file = tempfile.SpooledTemporaryFile(MEMORY_BYTES)  # noqa: SIM115 - the caller closes it
    try:
        with FileSink(file, form) as sink:
            report = pipeline.reconstruct(source, options, sink, max_pixels=max_pixels, progress=progress)
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
    except BaseException:
        file.close()
        raise
    return Answer(file, size, sink.format, report)


def _found(store: Store, key: str, noted: NotedFiles) -> Stored | None:
    """What is stored under `key`, where the files that it was made of are what they were; None where it is not."""
    found = store.get(key)
    if found is None:
        return None
    is_same = False
    try:
        is_same = noted.agree(found.head["read"])
    finally:
        if not is_same:
            found.body.close()
    return found if is_same else None


def _again(found: Stored, clock: Clock, progress: Progress | None) -> Answer:
    """The answer that was stored, with a report that says so; lets go of `found` where that or `progress` fails."""
    try:
        report: Report = dict(found.head["report"])
        if progress is not None:
            progress(len(report["views"]))
        report["timings_ms"] = clock.timings_ms()
        _replace_report(found.body, found.head["format"], report)
        size = found.body.seek(0, os.SEEK_END)
        found.body.seek(0)
    except BaseException:
        found.body.close()
        raise
    return Answer(found.body, size, found.head["format"], report)


def _replace_report(file: IO[bytes], form: str, report: Report) -> None:
    """Writes another report over the one in a zip or an npz, where it comes last; a PNG has none.

    Raises `ValueError` where something else comes last: then `service.outputs` no longer does what is relied on here.
    """
    if form == "png":
        return
    name = REPORT if form == "zip" else "report.npy"
    with zipfile.ZipFile(file, "a") as archive:
        last = archive.filelist[-1]
        if last.filename != name or last.header_offset < max(one.header_offset for one in archive.filelist):
            raise ValueError(f"{last.filename} comes last in a stored {form}, where {name} should")
        archive.filelist.pop()
        del archive.NameToInfo[last.filename]
        archive.start_dir = last.header_offset  # where the next file is written
        data = to_json(report)
        if form == "npz":
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.array(data.decode()), allow_pickle=False)
            data = buffer.getvalue()
        archive.writestr(zipfile.ZipInfo(last.filename, last.date_time), data, last.compress_type)


def _key(source: Source, options: Options, form: str | None, max_pixels: int | None) -> str:
    """64 hexadecimal digits."""
    what: list[Any] = [source]
    if isinstance(source, Bundle):
        names = [source.main] if source.main is not None else list(source.files)
        what = [source.name, source.main, [(name, hashlib.sha256(source.files[name]).hexdigest()) for name in names]]
    # Which network, renderer and strategy `auto` takes depends on the machine, too.
    here = [installation(), cost.machine(), processor.against_int8()]
    asked = json.dumps([here, what, options.as_dict(), form, max_pixels], sort_keys=True)
    return hashlib.sha256(asked.encode()).hexdigest()


@cache
def installation() -> str:
    """A hash of this package's code, cards and shaders and of the versions of what it calls; takes some 10 ms once."""
    digest = hashlib.sha256(json.dumps([(name, version(name)) for name in _PACKAGES]).encode())
    root = Path(__file__).parents[1]
    for folder in _CODE:
        for path in sorted(path for path in (root / folder).rglob("*") if path.suffix in _SUFFIXES):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _hash_of_names(names: list[str]) -> str:
    return hashlib.sha256(json.dumps(sorted(names)).encode()).hexdigest()
