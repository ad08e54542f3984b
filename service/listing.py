"""The list of models for `ciir models --json` and `GET /v1/models`."""

from __future__ import annotations

from typing import Any

from ciir.models import catalogue


def list_models() -> list[dict[str, Any]]:
    """Lists the models of the catalogue: name, kind, scales and input of each, `default` (for pictures),
    `unsupported_reason` (why this processor can't run it, or None) and card (or None)."""
    default = catalogue.picture_default_name()
    return [
        {
            "name": entry.name,
            "kind": entry.kind,
            "scales": list(entry.scales),
            "takes": "a view and those around it" if entry.is_light_field else "a picture",
            "default": entry.name == default,
            "unsupported_reason": entry.unsupported_reason or None,
            "card": entry.card.to_dict() if entry.card is not None else None,
        }
        for entry in catalogue.list_entries()
    ]
