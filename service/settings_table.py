"""All settings as text: as they are, for a terminal, and as they may be, for docs/settings.md.

``python -m ciir.service.settings_table > docs/settings.md``
"""

from __future__ import annotations

import importlib
import sys
import textwrap
from typing import TYPE_CHECKING, Any

from ciir.service import settings
from ciir.service.pipeline import cache_folder
from ciir.service.settings import PREFIX, Settings

if TYPE_CHECKING:
    from collections.abc import Iterator

_INTRO = f"""\
# Settings

Environment variables of the server and of workers. One that is empty counts as not set; one that is out of range ends
the command with a line that says what it may be; a name that begins with `{PREFIX}` and is no setting is logged as a
warning. `ciir serve --show-settings` prints the values in force. This page is generated from the settings' docstrings
by `python -m ciir.service.settings_table > docs/settings.md`.

Without `{PREFIX}FOLDER` the cache folder is used: `{cache_folder.NAME}`, else `ciir` in `XDG_CACHE_HOME` or in
`~/.cache`.

| setting | default | may be | |
|---|---|---|---|
"""


FIXED = {
    "renderer.readers.meshes.gltf.ELEMENTS": "elements in all accessors of a glTF file, per `CIIR_MAX_TRIANGLES`",
    "renderer.readers.meshes.gltf_scene.MAX_NODES": "nodes of a glTF scene",
    "renderer.readers.meshes.gltf_scene.MAX_PRIMITIVES": "primitives in all nodes of a glTF scene together",
    "renderer.readers.jpeg.MAX_SCANS": "scans in a progressive JPEG",
    "renderer.lens_array.MAX_LENSES": "lenses along one side",
    "renderer.lens_array.MAX_PIXELS": "pixels along one side of an elemental image",
    "renderer.readers.meshes.obj.MAX_LIBRARIES": "MTL files that an OBJ names",
    "renderer.readers.meshes.obj.MAX_MATERIALS": "materials that an OBJ uses",
    "renderer.readers.pictures.MAX_SIDE": "pixels along one side of a picture or a view",
    "renderer.backends.embree.MAX_LAYERS": "cut-out surfaces that a ray passes",
    "renderer.surface.MAX_COORDINATE": "the largest absolute coordinate",
    "renderer.surface.MAX_TEXTURE_COORDINATE": "the largest absolute texture coordinate; larger ones are taken as 0",
    "renderer.readers.meshes.texture_files.MAX_SIDE": "pixels along one side of a texture; larger ones are left out",
    "service.pipeline.plan.MAX_VIEW_PIXELS": "pixels in one view, in or out",
    "service.pipeline.plan.MAX_VIEW_SAMPLES": "points of a mesh that are sampled for one view",
    "service.pipeline.options.MAX_SCALE": "output pixels for each view pixel, along a side",
    "service.web.multipart.MAX_FIELDS": "fields in a form",
    "service.web.multipart.MAX_FIELD_BYTES": "bytes in a field that isn't the file",
}
"""Where a limit is that nobody can set, and what it is of."""
_FIXED_INTRO = """
## Limits that are fixed

| at most | of |
|---|---|
"""


def format_values() -> str:
    """Name, value, default and meaning of each as the environment has it; keys and passwords are not shown.

    Raises `InvalidOption` where one is out of range.
    """
    now = settings.read_settings()
    return "\n".join(
        f"{PREFIX}{name.upper()}={_shown(name, getattr(now, name))}  (default: {_shown(name, default) or 'none'})\n"
        + textwrap.fill(meaning, 100, initial_indent="    ", subsequent_indent="    ")
        for name, default, meaning in _all()
    )


def format_page() -> str:
    """docs/settings.md."""
    rows = [
        f"| `{PREFIX}{name.upper()}` | {_shown(name, default) or 'none'} | {settings.describe_values(name)} | {doc} |\n"
        for name, default, doc in _all()
    ]
    fixed = [f"| {_value(place):,.0f} | {what} |\n" for place, what in FIXED.items()]
    return _INTRO + "".join(rows) + _FIXED_INTRO + "".join(fixed)


def _value(place: str) -> float:
    module, _, name = place.rpartition(".")
    return float(getattr(importlib.import_module(f"ciir.{module}"), name))


def _all() -> Iterator[tuple[str, Any, str]]:
    """Name, default and meaning, in the order of the class."""
    for name, field in Settings.model_fields.items():
        yield name, field.default, " ".join((field.description or "").split())


def _shown(name: str, value: Any) -> str:
    if name == "api_keys":
        return f"{len(value)} keys" if value else ""
    if isinstance(value, tuple):
        return ",".join(value)
    if isinstance(value, float):
        return f"{value:g}"
    return "" if value is None else settings.hide_secrets(str(value))


if __name__ == "__main__":
    sys.stdout.write(format_page())
