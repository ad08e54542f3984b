"""Settings as text: the values in force for a terminal, and docs/settings.md.

``python -m ciir.service.settings_table > docs/settings.md``
"""

from __future__ import annotations

import importlib
import sys
import textwrap
from typing import TYPE_CHECKING, Any

from ciir.model_folder import MODEL_FOLDER
from ciir.service import settings
from ciir.service.pipeline.limits import SETTINGS
from ciir.service.settings import PREFIX, Settings

if TYPE_CHECKING:
    from collections.abc import Iterator

_INTRO = f"""\
# Settings

Environment variables of `ciir serve` and `ciir worker`. `ciir serve --show-settings` prints the values in force.

- An empty variable counts as not set.
- A value out of range ends the command with exit status 2 and one line that names the allowed values.
- A variable whose name begins with `{PREFIX}` but is not a setting is logged as a warning.
- Limits on inputs ({", ".join(f"`{name}`" for name, _, _ in SETTINGS.values())})
  also hold for the other commands and for Python; an input over one is refused with a line that names the variable.
- `{MODEL_FOLDER}` names a folder with further networks: `.onnx` files with their cards, as written by `ciir export`.
  `ciir models` lists them, and all commands, the API and Python accept their names. A process reads the folder once:
  restart `ciir serve` and `ciir worker` after a network was added or changed.

This page is generated: `python -m ciir.service.settings_table > docs/settings.md`.

| setting | default | values | meaning |
|---|---|---|---|
"""


FIXED_LIMITS = {
    "renderer.copies.MAX_COPIED": "triangles in all copies of meshes, per `CIIR_MAX_TRIANGLES`",
    "renderer.readers.meshes.gltf.document.ELEMENTS": "elements in all accessors of a glTF, per `CIIR_MAX_TRIANGLES`",
    "renderer.readers.meshes.geometry.MAX_NODES": "nodes of a mesh file's scene, counted once for each instance",
    "renderer.readers.meshes.gltf.scene.MAX_PRIMITIVES": "primitives in all nodes of a glTF scene together",
    "renderer.displays.quilt.MAX_TILES": "columns, and rows, of a quilt",
    "renderer.displays.quilt.MAX_ASPECT": "a quilt's aspect, width over height of a view",
    "renderer.displays.screen.MAX_CONE": "degrees of a display's viewing cone",
    "renderer.readers.jpeg.MAX_SCANS": "scans in a progressive JPEG",
    "renderer.lens_array.MAX_LENSES": "lenses, or samples of them, along one side",
    "renderer.lens_array.MAX_PIXELS": "pixels along one side of an elemental image",
    "renderer.readers.meshes.obj.MAX_LIBRARIES": "MTL files that an OBJ names",
    "renderer.readers.meshes.obj.MAX_MATERIALS": "materials that an OBJ uses",
    "renderer.readers.view_set.reader.MAX_REPORT": "bytes of the report next to views that states their depth sense",
    "renderer.readers.pictures.MAX_SIDE": "pixels along one side of a picture or a view",
    "renderer.backends.embree.MAX_LAYERS": "cut-out or see-through surfaces along a ray",
    "renderer.surface.MAX_COORDINATE": "the largest absolute coordinate",
    "renderer.surface.MAX_TEXTURE_COORDINATE": "the largest absolute texture coordinate; larger ones are taken as 0",
    "renderer.readers.meshes.texture_files.MAX_SIDE": "pixels along one side of a texture; larger ones are left out",
    "service.pipeline.limits.MAX_VIEW_PIXELS": "pixels in one view, in or out",
    "service.pipeline.limits.MAX_VIEW_SAMPLES": "points of a mesh that are sampled for one view",
    "service.pipeline.options.upscaling.MAX_SCALE": "output pixels per view pixel, along one side",
    "service.web.multipart.MAX_FIELDS": "fields in a form",
    "service.web.multipart.MAX_FILES": "files in a form, including those that describe a display",
    "service.web.multipart.MAX_FIELD_BYTES": "bytes of a form field other than the file",
}
"""Constant -> what it limits, for limits that are not settings."""
_FIXED_INTRO = """
## Fixed limits

| maximum | of |
|---|---|
"""


def format_values() -> str:
    """Lists name, value, default and meaning of each setting, without keys and passwords. Raises `InvalidOption`."""
    settings.warn_of_unknown()
    current = settings.read_settings()
    return "\n".join(
        f"{PREFIX}{name.upper()}={_format_value(name, getattr(current, name))}"
        f"  (default: {_format_value(name, default)})\n"
        + textwrap.fill(meaning, 100, initial_indent="    ", subsequent_indent="    ")
        for name, default, meaning in _list_settings()
    )


def format_page() -> str:
    """Returns the text of docs/settings.md."""
    rows = [
        f"| `{PREFIX}{name.upper()}` | {_format_value(name, default)} | {settings.describe_values(name)} | {doc} |\n"
        for name, default, doc in _list_settings()
    ]
    fixed = [f"| {_read_limit(place):,.0f} | {what} |\n" for place, what in FIXED_LIMITS.items()]
    return _INTRO + "".join(rows) + _FIXED_INTRO + "".join(fixed)


def _read_limit(place: str) -> float:
    module, _, name = place.rpartition(".")
    return float(getattr(importlib.import_module(f"ciir.{module}"), name))


def _list_settings() -> Iterator[tuple[str, Any, str]]:
    """Yields name, default and meaning of each setting."""
    for name, field in Settings.model_fields.items():
        yield name, field.default, " ".join((field.description or "").split())


def _format_value(name: str, value: Any) -> str:
    if value in (None, "", ()):
        return "none"
    if name == "api_keys":
        return f"{len(value)} keys"
    if isinstance(value, tuple):
        return ",".join(value)
    return f"{value:g}" if isinstance(value, float) else settings.hide_secrets(str(value))


if __name__ == "__main__":
    sys.stdout.write(format_page())
