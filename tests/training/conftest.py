"""A recipe that trains in a second on generated pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from ciir.training.recipe import Recipe

if TYPE_CHECKING:
    from pathlib import Path


def picture(seed: int, height: int, width: int) -> np.ndarray:
    """Makes a smooth 8-bit RGB picture, `(height, width, 3)`."""
    phase = np.random.default_rng(seed).random((3, 3)) * 6
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(y / 5 + a) + np.sin(x / 7 + b) + np.sin((x + y) / 4 + c) for a, b, c in phase]
    return (127.5 + 40 * np.stack(waves, axis=2)).clip(0, 255).round().astype(np.uint8)


@pytest.fixture(scope="session")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> Recipe:
    """Makes a recipe with three steps of a network of one block, validated after every second step."""
    folder: Path = tmp_path_factory.mktemp("pictures")
    (folder / "train").mkdir()
    (folder / "pairs").mkdir()
    for seed, (height, width) in enumerate([(40, 51), (33, 64), (20, 20)]):
        Image.fromarray(picture(seed, height, width)).save(folder / "train" / f"{seed}.png")
    for seed in (3, 4):
        high = picture(seed, 36, 44)
        low = high.reshape(18, 2, 22, 2, 3).mean(axis=(1, 3)).round().astype(np.uint8)
        Image.fromarray(high).save(folder / "pairs" / f"{seed}_HR.png")
        Image.fromarray(low).save(folder / "pairs" / f"{seed}_LR.png")
    return Recipe(
        name="tiny",
        network="lite",
        train=str(folder / "train"),
        validate=str(folder / "pairs"),
        steps=3,
        options={"blocks": 1, "channels": 8},
        crop=24,
        batch=2,
        learning_rate=1e-3,
        warmup=2,
        clip=0.5,
        seed=1,
        validate_every=2,
    )
