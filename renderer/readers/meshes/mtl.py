"""Reads MTL, the materials of a Wavefront OBJ."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ciir.renderer.surface import DEFAULT_COLOR, WHITE, Color

if TYPE_CHECKING:
    from ciir.renderer.readers.meshes.texture_files import Resolver
    from ciir.renderer.scene import Texture, Wrap

CONTINUED = re.compile(rb"\\\r?\n")
"""A line break within a line."""
_OPTIONS = {b"-blendu": 1, b"-blendv": 1, b"-boost": 1, b"-mm": 2, b"-o": 3, b"-s": 3, b"-t": 3, b"-texres": 1,
            b"-clamp": 1, b"-bm": 1, b"-imfchan": 1, b"-type": 1, b"-cc": 1}  # fmt: skip
_UNMOVED = {b"-o": 0.0, b"-s": 1.0}
"""Options that move or scale a texture, and the value that changes nothing."""
_CUTOFF = 0.5


@dataclass(frozen=True)
class Material:
    """The colour of a material."""

    color: Color = DEFAULT_COLOR
    texture: Texture | None = None
    alpha_cutoff: float | None = None


def parse_entries(data: bytes) -> dict[bytes, dict[bytes, bytes]]:
    """Parses an MTL file: for each material its keywords, in lower case, and the rest of their lines."""
    entries: dict[bytes, dict[bytes, bytes]] = {}
    entry: dict[bytes, bytes] = {}
    for line in CONTINUED.sub(b" ", data.removeprefix(b"\xef\xbb\xbf")).splitlines():
        word, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        if word.lower() == b"newmtl":
            entry = entries.setdefault(rest.strip(), {})
        elif word and not word.startswith(b"#"):
            entry[word.lower()] = rest.strip()
    return entries


def read_material(entry: dict[bytes, bytes], resolver: Resolver) -> Material:
    """Reads a material from its lines; `resolver` gets a note of what is left out."""
    texture, cutoff = None, None
    if b"map_kd" in entry:
        file_name, wrap, moved = _map(entry[b"map_kd"])
        if moved:
            resolver.add_note(
                "a texture's scale or offset (-s, -o) is left out: change the texture coordinates instead"
            )
        masked = b"map_d" in entry and _map(entry[b"map_d"])[0] == file_name
        texture = resolver.load_texture(file_name, opaque=not masked, wrap_u=wrap, wrap_v=wrap)
        cutoff = _CUTOFF if masked and texture is not None else None
    if b"map_d" in entry and cutoff is None:
        resolver.add_note("a map of opacity is left out: the material is drawn solid")
    if b"kd" in entry:
        words = entry[b"kd"].split()
        red, green, blue = (min(max(float(word), 0.0), 1.0) for word in (words * 3 if len(words) == 1 else words)[:3])
        color = (red, green, blue, 1.0)
    else:
        color = WHITE if texture else DEFAULT_COLOR
    if texture is not None and not any(color[:3]):
        resolver.add_note("a textured material has a black Kd, as some exporters write it: taken as white")
        color = WHITE
    return Material((*color[:3], _read_alpha(entry)), texture, cutoff)


def _read_alpha(entry: dict[bytes, bytes]) -> float:
    """The alpha of `d`, else of `Tr`, which is 1 - alpha. 0 counts as opaque: exporters disagree on which is which."""
    for keyword in (b"d", b"tr"):
        numbers = [float(word) for word in entry.get(keyword, b"").split() if _is_number(word)]  # after `-halo`
        if numbers and 0.0 < numbers[0] < 1.0:
            return numbers[0] if keyword == b"d" else 1.0 - numbers[0]
    return 1.0


def _map(line: bytes) -> tuple[str, Wrap, bool]:
    """The file name after a map's options, which may hold spaces; how the texture wraps; whether it is moved."""
    wrap: Wrap = "repeat"
    moved = False
    words, start = line.split(b" "), 0
    while start < len(words) and (option := words[start].lower()) in _OPTIONS:
        if option == b"-clamp" and words[start + 1 : start + 2] == [b"on"]:
            wrap = "clamp"
        values, end = _OPTIONS[option], start + 1
        while end <= start + values and end < len(words) - 1 and (values == 1 or _is_number(words[end])):
            end += 1
        if option in _UNMOVED:
            moved = moved or any(float(word) != _UNMOVED[option] for word in words[start + 1 : end])
        start = end
    return decode_name(b" ".join(words[start:]).strip()), wrap, moved


def _is_number(word: bytes) -> bool:
    return re.fullmatch(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", word) is not None


def decode_name(name: bytes) -> str:
    """Decodes a name as UTF-8, or else as Latin-1."""
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("latin-1")
