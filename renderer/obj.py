"""Wavefront OBJ and its MTL to surfaces, one for each material.

Read by this project's own code and not by trimesh 5.2, which counts negative indices from the end of the file and not
back from where they stand, so that real files come out as other shapes without a word; says nothing of a missing MTL,
material or texture; and opens textures of any kind and size that Pillow knows.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from renderer.errors import Unreadable
from renderer.names import shown
from renderer.surface import PLAIN, Surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from renderer.scene import Texture, Wrap
    from renderer.texture_files import Resolver

_CONTINUED = re.compile(rb"\\\r?\n")
_OPTIONS = {b"-blendu": 1, b"-blendv": 1, b"-boost": 1, b"-mm": 2, b"-o": 3, b"-s": 3, b"-t": 3, b"-texres": 1,
            b"-clamp": 1, b"-bm": 1, b"-imfchan": 1, b"-type": 1, b"-cc": 1}  # fmt: skip
_CUTOFF = 0.5
Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Material:
    color: Color = PLAIN
    texture: Texture | None = None
    alpha_cutoff: float | None = None


@dataclass
class _Lines:
    """The file's lines by their first word, and the number of the line that each stands in."""

    words: dict[bytes, list[bytes]] = field(default_factory=dict)
    numbers: dict[bytes, list[int]] = field(default_factory=dict)

    def array(self, word: bytes, least: int, most: int) -> NDArray[np.float64]:
        """The numbers after `word` as `(lines, least to most)`: as many columns as all of the lines have."""
        lines = self.words.get(word, [])
        if not lines:
            return np.empty((0, least))
        rows = [line.split() for line in lines]
        width = min(map(len, rows))
        if width < least:
            number = self.numbers[word][[len(row) for row in rows].index(width)]
            raise Unreadable(f"line {number + 1}: {shown(word.decode())} needs {least} numbers and has {width}")
        width = min(width, most)
        return np.array([row[:width] for row in rows]).astype(np.float64)


def surfaces(data: bytes, *, name: str, resolver: Resolver) -> list[Surface]:
    """The polygons of an OBJ as triangles (fans), grouped by material; lines, points and curves are left out.

    Colours are taken as display-referred: Kd, and the vertex colours that some scanners write after the position.
    Raises `Unreadable`, or one of `meshes.FAULTS`, where the text is not what OBJ says.
    """
    lines = _sorted(data)
    try:
        positions = lines.array(b"v", 3, 7)
        texture_coordinates = lines.array(b"vt", 1, 2)
        normals = lines.array(b"vn", 3, 3)
        corners, face_lines = _triangles(lines, (len(positions), len(texture_coordinates), len(normals)))
    except Unreadable as error:
        raise Unreadable(f"{name}: {error}; export it again") from error
    for word, what in ((b"l", "lines"), (b"p", "points"), (b"curv", "curves"), (b"surf", "free-form surfaces")):
        if word in lines.words:
            resolver.note(f"{what} are left out: only polygons are drawn")
    materials = _materials(lines, resolver)
    if texture_coordinates.shape[1] == 1:
        texture_coordinates = np.pad(texture_coordinates, ((0, 0), (0, 1)))
    found = []
    for material_name, chosen in _by_material(lines, face_lines):
        material = materials.get(material_name)
        if material is None:
            material = _Material()
            if material_name:
                resolver.note(
                    f"material {shown(material_name.decode('utf-8', 'replace'))} is missing: drawn light grey"
                )
        if material.texture is not None and (corners[chosen, :, 1] < 0).any():
            resolver.note("a texture is left out of a material that has corners without texture coordinates")
        found.append(_surface(corners[chosen], positions, texture_coordinates, normals, material))
    return found


def _sorted(data: bytes) -> _Lines:
    lines = _Lines()
    text = _CONTINUED.sub(b" ", data.removeprefix(b"\xef\xbb\xbf"))
    for number, line in enumerate(text.split(b"\n")):
        word, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        if word and not word.startswith(b"#"):
            lines.words.setdefault(word, []).append(rest.partition(b"#")[0] if word[:1] in b"vf" else rest)
            lines.numbers.setdefault(word, []).append(number)
    return lines


def _triangles(lines: _Lines, counts: tuple[int, int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """`(m, 3 corners, 3)` indices of position, texture coordinate and normal from 0, -1 where there is none; and the
    line `(m,)` that each triangle stands in, in the order of the file.
    """
    faces, numbers = lines.words.get(b"f", []), np.array(lines.numbers.get(b"f", []), np.int64)
    seen = [np.searchsorted(lines.numbers.get(word, []), numbers) for word in (b"v", b"vt", b"vn")]
    groups: dict[tuple[int, int, bool], list[int]] = {}
    for i, line in enumerate(faces):
        groups.setdefault((len(line.split()), line.count(b"/"), b"//" in line), []).append(i)
    found, found_in = [np.empty((0, 3, 3), np.int64)], [np.empty(0, np.int64)]
    for (count, slashes, gap), members in groups.items():
        if count < 3:
            continue  # no surface: counted with the triangles of zero area would be a guess at what was meant
        if slashes not in {0, count, 2 * count}:
            raise Unreadable(f"line {numbers[members[0]] + 1}: a face whose corners are written in different ways")
        per_corner = 1 if slashes == 0 else 2 if slashes == count or gap else 3
        text = b" ".join(faces[i] for i in members).replace(b"/", b" ")
        values = np.array(text.split()).astype(np.int64).reshape(len(members), count, per_corner)
        raw = np.zeros((len(members), count, 3), np.int64)  # as written: from 1, negative from the end, 0 for none
        raw[:, :, [0, 2] if gap else list(range(per_corner))] = values
        for kind in range(3):
            there = seen[kind][members][:, None]
            column = raw[:, :, kind]
            index = np.where(column < 0, column + there, column - 1)
            if ((column != 0) & ((index < 0) | (index >= counts[kind]))).any() or (kind == 0 and (column == 0).any()):
                raise Unreadable(f"a face names a {('vertex', 'vt', 'vn')[kind]} that isn't there")
            raw[:, :, kind] = np.where(column == 0, -1, index)
        fan = np.stack([raw[:, [0, i, i + 1]] for i in range(1, count - 1)], axis=1)  # (faces, fans, 3, 3)
        found.append(fan.reshape(-1, 3, 3))
        found_in.append(np.repeat(numbers[members], count - 2))
    corners, line_of = np.concatenate(found), np.concatenate(found_in)
    order = np.argsort(line_of, kind="stable")
    return corners[order], line_of[order]


def _by_material(lines: _Lines, face_lines: NDArray[np.int64]) -> list[tuple[bytes, NDArray[np.intp]]]:
    """Each material's name, empty for none, and the triangles that are made of it."""
    names = [b"", *(name.strip() for name in lines.words.get(b"usemtl", []))]
    current = np.searchsorted(lines.numbers.get(b"usemtl", []), face_lines)
    number = {name: i for i, name in reversed(list(enumerate(names)))}
    distinct = np.array([number[name] for name in names])[current]
    return [(names[i], np.flatnonzero(distinct == i)) for i in np.unique(distinct)]


def _surface(
    corners: NDArray[np.int64],
    positions: NDArray[np.float64],
    texture_coordinates: NDArray[np.float64],
    normals: NDArray[np.float64],
    material: _Material,
) -> Surface:
    """One vertex for each distinct triple of indices."""
    triples = corners.reshape(-1, 3)
    with_uv = material.texture is not None and bool((triples[:, 1] >= 0).all())
    with_normals = bool((triples[:, 2] >= 0).all())
    key = triples[:, 0]
    if with_uv:
        key = key * (len(texture_coordinates) + 1) + triples[:, 1]
    if with_normals:
        key = key * (len(normals) + 1) + triples[:, 2]
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    used = triples[first]
    colors = None
    if positions.shape[1] >= 6:
        colors = np.ones((len(used), 4), np.float32)
        colors[:, :3] = positions[used[:, 0], 3:6]
    color = (1.0, 1.0, 1.0, 1.0) if colors is not None and material == _Material() else material.color
    return Surface(
        vertices=positions[used[:, 0], :3],
        faces=vertex.reshape(-1, 3),
        normals=normals[used[:, 2]] if with_normals else None,
        color=color,
        colors=colors,
        uv=texture_coordinates[used[:, 1]] if with_uv else None,
        texture=material.texture if with_uv else None,
        alpha_cutoff=material.alpha_cutoff if with_uv else None,
    )


def _materials(lines: _Lines, resolver: Resolver) -> dict[bytes, _Material]:
    """All materials of all MTL files that the OBJ names."""
    materials: dict[bytes, _Material] = {}
    for library in lines.words.get(b"mtllib", []):
        data = resolver.find(_text(library.strip()), "material file")
        if data is not None:
            materials |= {name: _material(entry, resolver) for name, entry in _entries(data).items()}
    return materials


def _entries(data: bytes) -> dict[bytes, dict[bytes, bytes]]:
    """An MTL file's materials: for each the rest of the line after each word, words in lower case."""
    entries: dict[bytes, dict[bytes, bytes]] = {}
    entry: dict[bytes, bytes] = {}
    for line in _CONTINUED.sub(b" ", data.removeprefix(b"\xef\xbb\xbf")).splitlines():
        word, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        if word.lower() == b"newmtl":
            entry = entries.setdefault(rest.strip(), {})
        elif word and not word.startswith(b"#"):
            entry[word.lower()] = rest.strip()
    return entries


def _material(entry: dict[bytes, bytes], resolver: Resolver) -> _Material:
    texture, cutoff = None, None
    if b"map_kd" in entry:
        file_name, wrap = _map(entry[b"map_kd"])
        masked = b"map_d" in entry and _map(entry[b"map_d"])[0] == file_name
        texture = resolver.texture(file_name, opaque=not masked, wrap_u=wrap, wrap_v=wrap)
        cutoff = _CUTOFF if masked and texture is not None else None
    if b"map_d" in entry and cutoff is None:
        resolver.note("a map of opacity is left out: the material is drawn solid")
    if b"kd" in entry:
        words = entry[b"kd"].split()
        red, green, blue = (min(max(float(word), 0.0), 1.0) for word in (words * 3 if len(words) == 1 else words)[:3])
        color = (red, green, blue, 1.0)
    else:
        color = (1.0, 1.0, 1.0, 1.0) if texture else PLAIN
    if texture is not None and not any(color[:3]):
        resolver.note("a textured material has a black Kd, as some exporters write it: taken as white")
        color = (1.0, 1.0, 1.0, 1.0)
    return _Material(color, texture, cutoff)


def _map(line: bytes) -> tuple[str, Wrap]:
    """The file name, spaces and all, after a map's options; and how it goes on beyond its edges."""
    wrap: Wrap = "repeat"
    words = line.split(b" ")
    while words and words[0].lower() in _OPTIONS:
        option, values = words[0].lower(), _OPTIONS[words[0].lower()]
        if option == b"-clamp" and words[1:2] == [b"on"]:
            wrap = "clamp"
        taken = 1
        while taken <= values and taken < len(words) - 1 and (values == 1 or _is_number(words[taken])):
            taken += 1
        words = words[taken:]
    return _text(b" ".join(words).strip()), wrap


def _is_number(word: bytes) -> bool:
    return re.fullmatch(rb"[-+]?[\d.]+(?:[eE][-+]?\d+)?", word) is not None


def _text(name: bytes) -> str:
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")
