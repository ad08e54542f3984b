"""The folder of one's own networks."""

from __future__ import annotations

import os
from pathlib import Path

MODEL_FOLDER = "CIIR_MODELS"
"""The environment variable that names it: `.onnx` files with their `.json` cards, as `ciir export` writes them."""


def find_model_folder() -> Path | None:
    """The folder of `CIIR_MODELS`, absolute; None where it isn't set."""
    text = os.environ.get(MODEL_FOLDER)
    return Path(text).absolute() if text else None
