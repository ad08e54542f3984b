"""Reads MTL files, which hold the materials of a Wavefront OBJ."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.renderer.readers.names import clean_text
from ciir.renderer.surface import DEFAULT_COLOR, Color

if TYPE_CHECKING:
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.scene import Texture, Wrap

CONTINUED = re.compile(rb"\\\r?\n")
"""A backslash and line break, which continue a line."""
_OPTIONS = {b"-blendu": 1, b"-blendv": 1, b"-boost": 1, b"-mm": 2, b"-o": 3, b"-s": 3, b"-t": 3, b"-texres": 1,
            b"-clamp": 1, b"-bm": 1, b"-imfchan": 1, b"-type": 1, b"-cc": 1}  # fmt: skip
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_CUTOFF = 0.5


@dataclass(frozen=True)
class Material:
    """The colour of a material."""

    color: Color = DEFAULT_COLOR
    texture: Texture | None = None
    alpha_cutoff: float | None = None
    scale: tuple[float, float] = (1.0, 1.0)
    """The factor of the texture coordinates. It is applied before `offset` is added, as Blender and three.js do."""
    offset: tuple[float, float] = (0.0, 0.0)
    lit: bool = True


@dataclass(frozen=True)
class _Map:
    """A line that names a texture."""

    name: str
    wrap: Wrap = "repeat"
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    unread: tuple[str, ...] = ()
    """Options whose numbers can't be read."""


def parse_entries(data: bytes) -> dict[bytes, dict[bytes, bytes]]:
    """Parses an MTL file. Returns each material's keywords, in lower case, with the rest of their lines."""
    entries: dict[bytes, dict[bytes, bytes]] = {}
    entry: dict[bytes, bytes] = {}
    for line in CONTINUED.sub(b" ", data.removeprefix(b"\xef\xbb\xbf")).splitlines():
        word, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        if word.lower() == b"newmtl":
            entry = entries.setdefault(rest.strip(), {})
        elif word and not word.startswith(b"#"):
            entry[word.lower()] = rest.strip()
    return entries


def read_material(entry: dict[bytes, bytes], resolver: Resolver, name: str) -> Material:
    """Reads a material from its lines. `resolver` gets notes on what is left out, with `name` as the material's name.

    A material that is black except for the light that it emits gets the colour and the texture of that light.
    """
    diffuse, emitted = _read_color(entry.get(b"kd")), _read_color(entry.get(b"ke"))
    if diffuse is None and b"kd" in entry:
        _note_unread(f"Kd {decode_name(entry[b'kd'])}", name, resolver)
    emits = emitted is not None and any(emitted)
    lit = not emits or b"map_kd" in entry or diffuse is None or any(diffuse)
    if emits and lit:
        resolver.add_note("light that a material emits is left out: its diffuse colour is drawn")
    if not lit:
        diffuse = emitted
    placed, mask = _parse_map(entry.get(b"map_kd" if lit else b"map_ke")), _parse_map(entry.get(b"map_d"))
    for each in (placed, mask):
        for option in each.unread if each is not None else ():
            _note_unread(option, name, resolver)
    texture, is_cut = _load_texture(placed, mask, resolver)
    placed = placed or mask or _Map("")
    color = diffuse or ((1.0, 1.0, 1.0) if texture else DEFAULT_COLOR[:3])
    if texture is not None and not any(color):
        resolver.add_note("a textured material has a black Kd, as some exporters write it; white is used instead")
        color = (1.0, 1.0, 1.0)
    cutoff = _CUTOFF if is_cut else None
    return Material((*color, _read_alpha(entry)), texture, cutoff, placed.scale, placed.offset, lit)


def _load_texture(placed: _Map | None, mask: _Map | None, resolver: Resolver) -> tuple[Texture | None, bool]:
    """Loads the texture. Also returns whether `mask` cuts it out."""
    if mask is not None and placed is not None and mask.name == placed.name:
        texture = resolver.load_texture(placed.name, opaque=False, wrap_u=placed.wrap, wrap_v=placed.wrap)
        return texture, texture is not None
    if mask is not None:
        wrap = (placed or mask).wrap
        name = None if placed is None else placed.name
        masked = resolver.load_masked_texture(name, mask.name, wrap_u=wrap, wrap_v=wrap)
        if masked is not None:
            return masked, True
    if placed is None:
        return None, False
    return resolver.load_texture(placed.name, opaque=True, wrap_u=placed.wrap, wrap_v=placed.wrap), False


def _read_color(line: bytes | None) -> tuple[float, float, float] | None:
    """Reads red, green and blue, or one number for all three, in [0, 1]. Returns None if the line holds no colour, such
    as a spectral curve."""
    words = [] if line is None else line.split()
    try:
        red, green, blue = (min(max(float(word), 0.0), 1.0) for word in (words * 3 if len(words) == 1 else words)[:3])
    except ValueError:
        return None
    return red, green, blue


def _note_unread(line: str, material: str, resolver: Resolver) -> None:
    resolver.add_note(
        f"material {material}: {clean_text(line)} can't be read and is left out; write numbers as in 0.5 0.5 1"
    )


def _read_alpha(entry: dict[bytes, bytes]) -> float:
    """Returns the alpha from `d`, or else from `Tr`, which is 1 - alpha. 0 counts as opaque, because exporters disagree
    on which is which."""
    for keyword in (b"d", b"tr"):
        numbers = [float(word) for word in entry.get(keyword, b"").split() if _is_number(word)]  # after `-halo`
        if numbers and 0.0 < numbers[0] < 1.0:
            return numbers[0] if keyword == b"d" else 1.0 - numbers[0]
    return 1.0


def _parse_map(line: bytes | None) -> _Map | None:
    """Parses a map's options and the file name after them, which may contain spaces."""
    if line is None:
        return None
    wrap: Wrap = "repeat"
    moved = {b"-s": (1.0, 1.0), b"-o": (0.0, 0.0)}
    words, start, unread = line.split(b" "), 0, []
    while start < len(words) and (option := words[start].lower()) in _OPTIONS:
        if option == b"-clamp" and words[start + 1 : start + 2] == [b"on"]:
            wrap = "clamp"
        values, end = _OPTIONS[option], start + 1
        while end <= start + values and end < len(words) - 1 and (values == 1 or _is_number(words[end], b",")):
            end += 1
        if option in moved:
            given = words[start + 1 : end]
            if all(map(_is_number, given)):
                u, v = (*map(float, given[:2]), *moved[option][len(given) :])
                moved[option] = u, v
            else:
                unread.append(decode_name(b" ".join(words[start:end])))
        start = end
    return _Map(decode_name(b" ".join(words[start:]).strip()), wrap, moved[b"-s"], moved[b"-o"], tuple(unread))


def _is_number(word: bytes, comma: bytes = b".") -> bool:
    """Checks whether `word` is a number. `comma` is accepted as the decimal point."""
    return _NUMBER.fullmatch(word.replace(comma, b".")) is not None


def decode_name(name: bytes) -> str:
    """Decodes a name as UTF-8, or else as Latin-1, and removes the quotes that some exporters put around it."""
    if len(name) > 2 and name[:1] == name[-1:] == b'"':
        name = name[1:-1]
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")
