"""The schemas of the OpenAPI document, made from `schemas` and the options of each kind of job."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from ciir.renderer.scenes import SCENES
from ciir.service.pipeline.options import KINDS
from ciir.service.web.routes import schemas, upload

if TYPE_CHECKING:
    from ciir.service.pipeline.options import Kind

_FILE = {"type": "string", "format": "binary"}
_FILE_FORM = {
    "type": "object",
    "required": [upload.FILE],
    "additionalProperties": False,
    "properties": {upload.FILE: _FILE | {"description": "any file that a job takes; its name gives the type"}},
}


def describe_form(kind: Kind) -> dict[str, Any]:
    """Returns the JSON schema of the form for a kind of job."""
    scene = {"type": "string", "enum": list(SCENES), "description": "a shipped scene, instead of the file"}
    kept = "instead of the file: the id of a kept file, or of a finished job, whose result is then the input"
    described = {
        upload.FILE: _FILE | {"description": kind.takes},
        upload.FILE_ID: {"type": "string", "description": kept, "example": "0123456789abcdef0123456789abcdef"},
        **({upload.SCENE: scene} if kind.takes_scenes else {}),
        upload.FORMAT: {"type": "string", "enum": list(kind.formats), "description": f"default: {kind.default_format}"},
    }
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": described | {name: kind.describe_option(name) for name in kind.options},
    }


def make_schemas() -> dict[str, Any]:
    """Returns the schemas of the document, by name."""
    _, made = TypeAdapter.json_schemas(
        [(kind.__name__, "serialization", TypeAdapter(kind)) for kind in schemas.TYPES], ref_template=schemas.REF
    )
    forms = {f"{kind.name.title()}Form": describe_form(kind) for kind in KINDS.values()}
    found: dict[str, Any] = to_openapi_3_0(made["$defs"])
    return found | forms | {"FileForm": _FILE_FORM}


def to_openapi_3_0(schema: Any) -> Any:
    """Converts a document to the dialect of OpenAPI 3.0: `nullable` for the type null, one `example`.

    Titles are left out, because they only repeat the names.
    """
    if isinstance(schema, list):
        return [to_openapi_3_0(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    changed = {
        key: to_openapi_3_0(value) for key, value in schema.items() if key != "title" or not isinstance(value, str)
    }
    if isinstance(changed.get("examples"), list):
        changed["example"] = changed.pop("examples")[0]
    if {"type": "null"} in (options := changed.get("anyOf", [])):
        options.remove({"type": "null"})
        if len(options) == 1:
            (only,) = changed.pop("anyOf")
            changed = ({"allOf": [only]} if "$ref" in only else only) | changed
        changed |= {"nullable": True} | ({"enum": [*changed["enum"], None]} if "enum" in changed else {})
    return changed
