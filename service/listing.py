"""The models that can be named, for `ciir models --json` and `GET /v1/models` alike."""

from __future__ import annotations

from typing import Any

from ciir.models import catalogue


def list_models() -> list[dict[str, Any]]:
    """Each entry of the catalogue: name, kind, scales, what it takes, whether it is the default for single pictures,
    and the card (null for none).
    """
    default = catalogue.default_name()
    return [
        {
            "name": entry.name,
            "kind": entry.kind,
            "scales": list(entry.scales),
            "takes": "a view and those around it" if entry.is_light_field else "a picture",
            "default": entry.name == default,
            "card": entry.card.to_dict() if entry.card is not None else None,
        }
        for entry in catalogue.list_entries()
    ]
