"""The inputs of a batch: turns files, globs, folders and URLs into tasks with the names of their outputs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from glob import escape, has_magic
from itertools import groupby
from pathlib import PurePath, PurePosixPath
from typing import TYPE_CHECKING, Any

from ciir.errors import InputError, InvalidOption
from ciir.renderer.readers.names import clean_text, is_hidden
from ciir.renderer.readers.registry import SUFFIXES, VIDEOS, has_texture_files, is_picture, may_be_texture
from ciir.renderer.readers.view_set.grid import find_grids
from ciir.service.batch.places import open_filesystem, reach_store, resolve
from ciir.service.batch.task import Task
from ciir.service.pipeline.source import SCENE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FIELDS = ("path", "name", "stem", "suffix", "number")
"""Fields allowed in braces in the pattern for names."""
MINIMUM_SET = 2
"""Fewest rows and columns of views for a folder of pictures to be taken as one light field."""


@dataclass(frozen=True)
class Found:
    """An input, and its path in the folder or the glob in which it was found."""

    source: str
    path: str
    is_folder: bool = False
    is_texture: bool = False
    """Whether it is a picture in a folder, next to or below a mesh whose textures are files."""


def find_inputs(texts: Sequence[str], *, has_arrays: bool, sets: bool) -> tuple[list[Found], list[Found]]:
    """Finds the inputs that `texts` name, in order, each once, and the pictures that are left out as textures.

    A file is an input. A folder, given or matched by a glob, stands for all files of supported types in it and below
    it; with `sets` it is one input, as for `ciir reconstruct`. A folder of pictures that fill a grid of views is also
    one input, unless `has_arrays`, which means that the options give the lenses of elemental image arrays. Other
    pictures in a folder with a mesh whose textures are files, or below it, belong to the mesh, as for `ciir
    reconstruct`: they are inputs only if they are given by name or matched by a glob.

    Raises `InvalidOption` if one of them names nothing.
    """
    found: dict[PurePath, Found] = {}
    for text in texts:
        new = [Found(text, text.removeprefix(SCENE))] if text.startswith(SCENE) else list(_find(text, has_arrays, sets))
        if not new:
            raise InvalidOption(f"{text}: holds no input; give files of supported types")
        for each in new:
            place = resolve(each.source)[0]
            if place not in found or found[place].is_texture:
                found[place] = each
    inputs = [each for each in found.values() if not each.is_texture]
    return inputs, [each for each in found.values() if each.is_texture]


def _find(text: str, has_arrays: bool, sets: bool) -> Iterator[Found]:
    if not text:
        raise InvalidOption("INPUT: '' is not a name; give a file, a folder, a glob, or . for this folder")
    files, path = open_filesystem(text)
    with reach_store(text, files):
        yield from _find_in(files, path, text, has_arrays, sets)


def _find_in(files: Any, path: str, text: str, has_arrays: bool, sets: bool) -> Iterator[Found]:
    if files.isdir(path):
        yield from _look_in(files, path, PurePosixPath(path), has_arrays, sets)
    elif files.exists(path):
        yield _describe(files, path, PurePosixPath(path).parent)
    elif has_magic(path):
        fixed = _find_fixed_folder(path)
        for match in sorted(files.glob(path)):
            if is_hidden(str(PurePosixPath(match).relative_to(fixed))):
                continue
            if files.isdir(match):
                yield from _look_in(files, match, fixed, has_arrays, sets)
            else:
                yield _describe(files, match, fixed)
    else:
        raise InvalidOption(f"{text}: there is no such file or folder; check the name")


def _find_fixed_folder(pattern: str) -> PurePosixPath:
    """Returns the folders of a glob before its first part with a wildcard."""
    parts = PurePosixPath(pattern).parts
    return PurePosixPath(*parts[: next(number for number, part in enumerate(parts) if has_magic(part))])


def _look_in(files: Any, folder: str, root: PurePosixPath, has_arrays: bool, sets: bool) -> Iterator[Found]:
    if sets:
        yield _describe(files, folder, root, is_folder=True)
        return
    paths = sorted(path for path in files.find(folder) if not is_hidden(str(PurePosixPath(path).relative_to(folder))))
    read = [path for path in paths if PurePosixPath(path).suffix.lower() in SUFFIXES]
    of_meshes = {PurePosixPath(path).parent for path in read if has_texture_files(path)}
    for parent, group in groupby(read, lambda path: str(PurePosixPath(path).parent)):
        names = list(group)
        pictures = [PurePosixPath(path).name for path in names if is_picture(path)]
        if not has_arrays and len(pictures) == len(names) and _is_view_set(pictures):
            yield _describe(files, parent, root, is_folder=True)
        else:
            is_beside = not of_meshes.isdisjoint((PurePosixPath(parent), *PurePosixPath(parent).parents))
            for path in names:
                yield _describe(files, path, root, is_texture=is_beside and may_be_texture(path))


def _is_view_set(names: Sequence[str]) -> bool:
    """Checks whether the pictures fill a grid of views, judging by their names."""
    try:
        grids = find_grids(names, "")
    except InputError:
        return False
    return any(min(grid.shape) >= MINIMUM_SET for grid in grids)


def describe_textures(textures: Sequence[Found]) -> list[str]:
    """Returns the note on pictures that were left out, if there are any, with a glob that includes some of them."""
    if not textures:
        return []
    count, path = len(textures), PurePosixPath(textures[0].source)
    what = "1 picture next to or below a mesh is" if count == 1 else f"{count} pictures next to or below meshes are"
    pattern = f"{escape(textures[0].source.removesuffix(path.name))}*{path.suffix}"
    return [f"{what} left out as textures; to include them, give names or globs too, such as {pattern!r}"]


def _describe(
    files: Any, path: str, root: PurePosixPath, *, is_folder: bool = False, is_texture: bool = False
) -> Found:
    relative = PurePosixPath(path).relative_to(root)
    if not relative.name:
        relative = PurePosixPath(PurePosixPath(path).name)
    is_local = files.protocol in ("file", ("file", "local"))
    return Found(path if is_local else files.unstrip_protocol(path), str(relative), is_folder, is_texture)


def make_tasks(found: Sequence[Found], pattern: str, *, is_file: bool, all_frames: bool) -> list[Task]:
    """Makes a task for each input. `pattern` gives the name of its output, with `FIELDS` in braces.

    `path`: the input's path in the folder or glob in which it was found, without its suffix; `name`: the file's name
    with its suffix; `stem`: the name without it; `suffix`: the suffix alone, such as `png`; `number`: its place among
    all inputs, 0001 for the first, which changes when inputs are added. `is_file`: whether the suffix of `pattern` is a
    format's. `all_frames`: whether the frames of videos are elemental image arrays. Their output is then a video of the
    same type, unless the pattern has a suffix, or `/` at its end.

    Raises `InvalidOption` for a wrong pattern, and if two outputs have the same name.
    """
    if re.search(r"[{}]", re.sub(rf"\{{({'|'.join(FIELDS)})\}}", "", pattern)) or not pattern.strip("/"):
        raise InvalidOption(f"--name: {pattern!r} is not understood; use {', '.join(f'{{{name}}}' for name in FIELDS)}")
    tasks: dict[str, Task] = {}
    digits = max(4, len(str(len(found))))
    for number, each in enumerate(found, 1):
        out = _fill(pattern, each, f"{number:0{digits}}")
        kind = SUFFIXES.get(PurePosixPath(each.path).suffix.lower())
        is_video = all_frames and not each.is_folder and kind is not None and kind.name in VIDEO_SUFFIXES
        gets_suffix = is_video and not is_file and not pattern.endswith("/")
        if kind is not None and gets_suffix:
            out += VIDEO_SUFFIXES[kind.name]
        out = out.strip("/")
        if not out or ".." in PurePosixPath(out).parts or is_hidden(out):
            raise InvalidOption(f"--name: {clean_text(out)} is outside the folder or hidden; give another pattern")
        if out in tasks:
            raise InvalidOption(
                f"{each.source}: its output would have the same name as that of {tasks[out].source}, {out}; "
                f"{_advise_name(found, PurePosixPath(pattern).suffix if is_file else '')}"
            )
        tasks[out] = Task(each.source, out, is_file=is_file or gets_suffix, is_video=is_video)
    return list(tasks.values())


def _fill(pattern: str, each: Found, number: str) -> str:
    path = PurePosixPath(each.path)
    bare, suffix = (path, "") if each.is_folder else (path.with_suffix(""), path.suffix.removeprefix("."))
    return pattern.format(path=bare, name=path.name, stem=bare.name, suffix=suffix, number=number)


def _advise_name(found: Sequence[Found], suffix: str) -> str:
    """Returns advice on a pattern, with the suffix of files, that gives each input a different name."""
    pattern = f"{{path}}_{{suffix}}{suffix}"
    if len({_fill(pattern, each, "") for each in found}) == len(found):
        return f"give --name '{pattern}'"
    return (
        "give a folder that holds both, so that their {path} differs, or --name with {number} in it, which changes if "
        "inputs are added"
    )


VIDEO_SUFFIXES = dict(zip(VIDEOS, (".mp4", ".webm", ".gif"), strict=True))
"""Containers with frames -> the suffix of a video made from one."""
