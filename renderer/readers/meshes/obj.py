"""Reads Wavefront OBJ as surfaces, one for each texture; `renderer.readers.meshes.mtl` reads its materials.

trimesh 5.2 is not used. Without an error it counts negative indices from the end of the file instead of their own line,
and ignores a missing MTL, material or texture. It also opens textures of any format and size.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes import mtl
from ciir.renderer.readers.meshes.geometry import parse_numbers, scale_levels
from ciir.renderer.readers.meshes.polygons import triangulate
from ciir.renderer.readers.meshes.text_lines import (
    Rows,
    count_in_rows,
    find_words,
    list_words,
    sort_lines,
)
from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import WHITE, Surface, check_size

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.meshes.texture_files import Resolver

_NUMBERS = (b"v", b"vt", b"vn", b"f")
_NAMES = (b"usemtl", b"mtllib")
_LEFT_OUT = {b"l": "lines", b"p": "points", b"curv": "curves", b"surf": "free-form surfaces"}
_COMMENT = re.compile(rb"(?mi)^([ \t\r\v\f]*(?:v|vt|vn|f)[ \t\r\v\f][^#\n]*)#[^\n]*")
_MANY = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)
"""The separator between several MTL files on a line. Spaces elsewhere are part of a name."""
MAX_LIBRARIES = 100
"""The most MTL files that an OBJ may name."""
MAX_MATERIALS = 65_536
"""The most materials that an OBJ may use."""


@dataclass(frozen=True, eq=False)
class _Lines:
    """The file's text, and its lines by keyword."""

    text: bytes
    rows: dict[bytes, Rows]

    def count_before(self, word: bytes, lines: NDArray[np.int64]) -> NDArray[np.intp]:
        """Counts the lines of `word` that come before each of `lines`."""
        return np.searchsorted(self.rows[word].numbers, lines)

    def list_names(self, word: bytes) -> list[bytes]:
        """Returns the text after `word` in each of its lines."""
        rows = self.rows[word]
        lines = rows.join(self.text).split(b"\n")[: len(rows)]
        return [b"".join(line.replace(b"\t", b" ").split(None, 1)[1:]).rstrip() for line in lines]

    def array(self, word: bytes, least: int, most: int) -> NDArray[np.float64]:
        """Parses the numbers after `word` as `(lines, least to most)`, with the columns that all of its lines have."""
        rows = self.rows[word]
        if not len(rows):
            return np.empty((0, least))
        width = int(rows.widths.min())
        if width < least:
            number = rows.numbers[rows.widths.argmin()]
            raise Unreadable(f"line {number + 1}: {clean_text(word.decode())} needs {least} numbers and has {width}")
        width = min(width, most)
        return parse_numbers(list_words(rows.join(self.text), rows.widths, width)).reshape(-1, width)


def read(data: bytes, *, name: str, resolver: Resolver, limits: Limits) -> list[Surface]:
    """Reads the polygons of an OBJ as triangles, grouped by texture. Lines, points and curves are left out.

    Colours are taken as display-referred: Kd, and the vertex colours that some scanners write after the position.
    Raises `TooLarge` over `limits`, and `Unreadable` or a built-in Python error if the text is malformed.
    """
    lines = _sort_lines(data, name, limits.triangles)
    try:
        positions = lines.array(b"v", 3, 7)
        texture_coordinates = lines.array(b"vt", 1, 2)
        normals = lines.array(b"vn", 3, 3)
        corners, face_lines = _triangles(lines, positions[:, :3], name, resolver, limits.triangles)
    except Unreadable as error:
        raise Unreadable(f"{name}: {error}; export it again") from error
    if positions.shape[1] >= 6:
        positions[:, 3:6] = scale_levels(positions[:, 3:6], resolver)
    for word, what in _LEFT_OUT.items():
        if len(lines.rows[word]):
            resolver.add_note(f"{what} are left out: only polygons are drawn")
    if texture_coordinates.shape[1] == 1:
        texture_coordinates = np.pad(texture_coordinates, ((0, 0), (0, 1)))
    materials, material_of = _materials(lines, face_lines, name, resolver)
    return [
        _surface(corners[chosen], (positions, texture_coordinates, normals), materials, material_of[chosen])
        for chosen in _group_triangles(corners, materials, material_of, resolver)
    ]


def _sort_lines(data: bytes, name: str, max_triangles: int) -> _Lines:
    text = data.removeprefix(b"\xef\xbb\xbf")
    text = mtl.CONTINUED.sub(b" ", text) if b"\\" in text else text
    rows = sort_lines(text, (*_NUMBERS, *_NAMES, *_LEFT_OUT))
    if any(b"#" in rows[word].join(text) for word in _NUMBERS):
        text = _COMMENT.sub(rb"\1", text)
        rows = sort_lines(text, tuple(rows))
    for word in (*_NUMBERS, *_NAMES):
        most = max_triangles if word == b"f" else 3 * max_triangles
        if len(rows[word]) > most:
            raise TooLarge(
                f"{name}: over {most:,} lines of {word.decode()}, more than the {max_triangles:,} triangles that may "
                "be read can use; decimate the mesh",
                "triangles",
            )
    return _Lines(text, rows)


def _triangles(
    lines: _Lines, positions: NDArray[np.float64], name: str, resolver: Resolver, max_triangles: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the triangles as indices `(m, 3 corners, 3)` of position, texture coordinate and normal, from 0, or -1 if
    there is none. Also returns the line number `(m,)` of each triangle. Both are in the order of the file.
    """
    faces = lines.rows[b"f"]
    line_of, joined = faces.numbers, faces.join(lines.text)
    data = np.frombuffer(joined, np.uint8)
    is_slash = data == ord("/")
    slashes = count_in_rows(is_slash, faces)
    is_slash[:-1] &= is_slash[1:]
    is_slash[-1:] = False
    gaps = count_in_rows(is_slash, faces) > 0
    written = count_in_rows(find_words(data, b"/"), faces) - 1
    lengths = np.where(faces.widths < 3, 0, faces.widths)  # with fewer corners there is no surface
    each = np.where(slashes == 0, 1, np.where((slashes == lengths) | gaps, 2, 3))  # numbers in a corner
    odd = (slashes != 0) & (slashes != lengths) & (slashes != 2 * lengths) | (written != each * lengths)
    odd &= lengths > 0
    if odd.any():
        raise Unreadable(f"line {line_of[odd.argmax()] + 1}: a face whose corners are written in different ways")
    check_size(name, int(np.maximum(lengths - 2, 0).sum()), len(lines.rows[b"v"]), max_triangles)
    raw = np.zeros((int(lengths.sum()), 3), np.int64)  # as written: from 1, or negative from the end, or 0 for none
    for per_corner, gap in sorted(set(zip(each.tolist(), gaps.tolist(), strict=True))):
        alike = (lengths > 0) & (each == per_corner) & (gaps == gap)
        members = faces.select(alike)
        words = list_words(members.join(lines.text).replace(b"/", b" "), written[alike])
        values = np.fromiter(map(int, words), np.int64).reshape(-1, per_corner)
        rows = np.flatnonzero(np.repeat(alike, lengths))
        for column, value in zip((0, 2) if gap else (0, 1, 2), values.T, strict=False):
            raw[rows, column] = value
    for column, word in enumerate((b"v", b"vt", b"vn")):
        given = raw[:, column]
        index = np.where(given < 0, given + np.repeat(lines.count_before(word, line_of), lengths), given - 1)
        wrong = ((given != 0) | (column == 0)) & ((index < 0) | (index >= len(lines.rows[word])))
        if wrong.any():
            corner = int(wrong.argmax())
            raise Unreadable(
                f"line {np.repeat(line_of, lengths)[corner] + 1}: a face names {word.decode()} {given[corner]} "
                f"but there are {len(lines.rows[word]):,}"
            )
        raw[:, column] = np.where(given == 0, -1, index)
    triangles, face_of = triangulate(positions, raw[:, 0], lengths, resolver.add_note)
    return raw[triangles], line_of[face_of]


def _materials(
    lines: _Lines, face_lines: NDArray[np.int64], name: str, resolver: Resolver
) -> tuple[list[mtl.Material], NDArray[np.intp]]:
    """Returns the distinct materials of the triangles, and the index of each triangle's material."""
    entries: dict[bytes, dict[bytes, bytes]] = {}
    names = [b"", *lines.list_names(b"usemtl")]
    for data in _find_libraries(lines.list_names(b"mtllib"), set(names), name, resolver):
        entries |= mtl.parse_entries(data)
    if (count := len(set(names))) > MAX_MATERIALS:
        raise TooLarge(f"{name}: {count:,} materials; at most {MAX_MATERIALS:,} are read; join them")
    current = lines.count_before(b"usemtl", face_lines)
    numbers_of: dict[mtl.Material, int] = {}
    by_name: dict[bytes, int] = {}
    missing = []
    for used in dict.fromkeys(names[i] for i in np.flatnonzero(np.bincount(current))):
        shown = clean_text(mtl.decode_name(used))
        material = mtl.read_material(entries[used], resolver, shown) if used in entries else mtl.Material()
        if used and used not in entries:
            missing.append(shown)
        by_name[used] = numbers_of.setdefault(material, len(numbers_of))
    if missing:
        listed = ", ".join(missing[:3]) + (", ..." if missing[3:] else "")
        many = f"material {listed} is" if len(missing) == 1 else f"{len(missing):,} materials ({listed}) are"
        resolver.add_note(f"{many} missing: drawn light grey")
    return list(numbers_of), np.array([by_name.get(used, 0) for used in names])[current]


def _find_libraries(given: list[bytes], used: set[bytes], name: str, resolver: Resolver) -> Iterable[bytes]:
    """Returns the files that the `mtllib` lines name. If none is found, returns the only MTL file there is, provided
    that it has a material in `used`.

    The files are in the order of their names. If several names refer to one file, the last of them counts.
    """
    names: dict[str, None] = {}
    for line in dict.fromkeys(map(mtl.decode_name, given)):
        alone = len(names) >= MAX_LIBRARIES or resolver.find(line) is not None
        names |= dict.fromkeys([line] if alone else _MANY.split(line))
    if len(names) > MAX_LIBRARIES:
        raise TooLarge(f"{name}: {len(names):,} material files; at most {MAX_LIBRARIES} are read; join them")
    files: dict[bytes, None] = {}
    for library in names:
        if (data := resolver.find(library)) is not None:
            files.pop(data, None)
            files[data] = None
    if not files and (only := resolver.find_only(".mtl")) is not None and used & mtl.parse_entries(only[1]).keys():
        resolver.add_note(f"the mesh's material files are missing: {clean_text(only[0])}, the only one found, is used")
        return [only[1]]
    for library in names:
        resolver.find_or_note(library, "material file")
    return files


def _group_triangles(
    corners: NDArray[np.int64], materials: list[mtl.Material], material_of: NDArray[np.intp], resolver: Resolver
) -> list[NDArray[np.intp]]:
    """Groups triangles into surfaces: by texture, and by whether texture coordinates and normals are complete."""
    incomplete = np.zeros((len(materials), 3), bool)  # whether a corner lacks (position,) texture coordinate, normal
    for column in (1, 2):
        incomplete[material_of[(corners[:, :, column] < 0).any(axis=1)], column] = True
    groups: dict[tuple[object, ...], int] = {}
    group_of = []
    for material, lacks in zip(materials, incomplete, strict=True):
        if material.texture is not None and lacks[1]:
            resolver.add_note("a texture is left out: its material has corners without texture coordinates")
        key = (
            material.texture,
            material.alpha_cutoff,
            material.color[3] < 1,
            material.texture is not None and lacks[1],
            lacks[2],
            material.lit,
        )
        group_of.append(groups.setdefault(key, len(groups)))
    group = np.array(group_of, np.intp)[material_of]
    order = np.argsort(group, kind="stable")
    ends = np.cumsum(np.bincount(group, minlength=len(groups)))
    return [chosen for chosen in np.split(order, ends[:-1]) if len(chosen)]


def _surface(
    corners: NDArray[np.int64],
    arrays: tuple[NDArray[np.float64], ...],
    materials: list[mtl.Material],
    material_of: NDArray[np.intp],
) -> Surface:
    """Makes a surface with one vertex for each distinct triple of indices into `arrays` and each material, which gives
    the vertex its colour.
    """
    positions, texture_coordinates, normals = arrays
    triples = corners.reshape(-1, 3)
    material = materials[material_of[0]]
    with_uv = material.texture is not None and bool((triples[:, 1] >= 0).all())
    with_normals = bool((triples[:, 2] >= 0).all())
    made_of = np.repeat(material_of, 3)
    columns = [(made_of, len(materials))]
    if with_uv:
        columns.append((triples[:, 1], len(texture_coordinates)))
    if with_normals:
        columns.append((triples[:, 2], len(normals)))
    key, most = triples[:, 0], len(positions)
    for column, count in columns:
        if most * count > np.iinfo(np.int64).max:
            key, most = np.unique(key, return_inverse=True)[1], len(key)
        key, most = key * count + column, most * count
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    used, made_of = triples[first], made_of[first]
    measured = positions.shape[1] >= 6  # vertex colours, which replace the grey of surfaces without a material
    tints = [WHITE if measured and material == mtl.Material() else material.color for material in materials]
    colors = np.array(tints, np.float32)[made_of]
    if measured:
        colors[:, :3] *= positions[used[:, 0], 3:6]
    scales, offsets = (np.array([getattr(each, name) for each in materials]) for name in ("scale", "offset"))
    return Surface(
        vertices=positions[used[:, 0], :3],
        faces=vertex.reshape(-1, 3),
        normals=normals[used[:, 2]] if with_normals else None,
        colors=colors,
        uv=texture_coordinates[used[:, 1]] * scales[made_of] + offsets[made_of] if with_uv else None,
        texture=material.texture if with_uv else None,
        alpha_cutoff=material.alpha_cutoff if with_uv else None,
        is_see_through=material.alpha_cutoff is None and material.color[3] < 1,
        lit=material.lit,
    )
