"""`ciir models`: lists the models."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from ciir.service import listing
from ciir.service.cli import common
from ciir.service.pipeline.options import AUTO_MODEL

if TYPE_CHECKING:
    import argparse

HEAD = ("name", "scales", "takes", "computes in", "parameters", "PSNR, dB on Y", "what it is")


def run(args: argparse.Namespace) -> None:
    """Lists the models, one on each line, or as JSON."""
    models = listing.list_models()
    if args.json:
        common.print_line(json.dumps(models, indent=2, ensure_ascii=False))
        return
    rows = [HEAD, *map(_row, models)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    for row in rows:
        common.print_line("  ".join([cell.ljust(width) for cell, width in zip(row, widths, strict=False)] + [row[-1]]))
    common.print_line(f"model auto, which `ciir reconstruct` uses unless another is named: {AUTO_MODEL}")
    for model in models:
        if reason := model["unsupported_reason"]:
            common.print_line(f"{model['name']} does not run on this machine: {reason}; {_remedy(model['card'])}")


def _row(model: dict[str, Any]) -> tuple[str, ...]:
    card = model["card"]
    scales = model["scales"]
    listed = str(scales[0]) if len(scales) == 1 else f"{scales[0]} to {scales[-1]}"
    name = model["name"] + (" (for pictures)" if model["default"] else "")
    if card is None:
        return name, listed, model["takes"], "float32", "-", "-", model["kind"]
    scores = ", ".join(f"{score['data']} {score['psnr']:.2f}" for score in card["accuracy"])
    return name, listed, model["takes"], card["precision"], f"{card['parameters']:,}", scores or "-", model["kind"]


def _remedy(card: dict[str, Any]) -> str:
    return f"use {card['float_twin']}" if card["float_twin"] else "use a float network"
