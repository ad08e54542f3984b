"""The folder that holds the user's own networks."""

from __future__ import annotations

import os
from pathlib import Path

MODEL_FOLDER = "CIIR_MODELS"
"""The environment variable with the folder of `.onnx` files and `.json` cards, as `ciir export` writes them."""


def find_model_folder() -> Path | None:
    """Returns the folder named by `CIIR_MODELS`, as an absolute path; None if it isn't set."""
    text = os.environ.get(MODEL_FOLDER)
    return Path(text).absolute() if text else None
