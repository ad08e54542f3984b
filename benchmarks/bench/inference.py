"""One picture through a network by each engine that is here: what the paper's authors would run, and what we run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from ciir.benchmarks.bench.methods import PAPER
from ciir.benchmarks.bench.timing import Times, in_turns, timed
from ciir.models import catalogue

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Engine = Callable[[NDArray[np.float32]], NDArray[np.float32]]

SIZES = ((100, 100), (200, 200), (512, 512))
REFERENCE = f"{PAPER}: torch, eager"


@dataclass(frozen=True)
class Row:
    """One engine at one size."""

    engine: str
    height: int
    width: int
    times: Times
    differs: float
    """Largest difference from onnxruntime's float output of the same network, levels of 8 bits."""


def engines(models: Sequence[str]) -> tuple[dict[str, Engine], dict[str, str]]:
    """`NETWORK: ENGINE` -> what runs it, and what is missing here -> why."""
    found: dict[str, Engine] = {f"{name}: onnxruntime": catalogue.load_upscaler(name) for name in models}
    missing: dict[str, str] = {}
    if PAPER in models:
        if find_spec("torch") and find_spec("onnx"):
            found = {REFERENCE: _torch()} | found
        else:
            missing[REFERENCE] = "torch is not installed; run pip install 'ciir[training]'"
    return found, missing


def _torch() -> Engine:
    import torch

    from ciir.benchmarks.stress.networks.in_torch import network

    graph = network((catalogue.SHIPPED / f"{PAPER}.onnx").read_bytes())

    def run(image: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.inference_mode():
            return np.asarray(np.clip(graph(torch.from_numpy(image)).numpy(), 0.0, 1.0))

    return run


def rows(
    models: Sequence[str], *, rounds: int, sizes: Sequence[tuple[int, int]] = SIZES
) -> tuple[list[Row], dict[str, str]]:
    """Every engine at every size, and what is missing -> why."""
    found, missing = engines(models)
    measured: list[Row] = []
    for height, width in sizes:
        image = _picture(height, width)
        jobs = {name: partial(timed, partial(engine, image)) for name, engine in found.items()}
        reference = REFERENCE if REFERENCE in jobs else f"{PAPER}: onnxruntime"
        times = in_turns(jobs, rounds, reference=reference)
        for name, engine in found.items():
            network = name.partition(":")[0]
            card = next(entry.card for entry in catalogue.list_entries() if entry.name == network)
            twin = card.float_twin if card is not None and card.float_twin else network
            far = float(np.abs(engine(image) - catalogue.load_upscaler(twin)(image)).max()) * 255
            measured.append(Row(name, height, width, times[name], far))
    return measured, missing


def _picture(height: int, width: int) -> NDArray[np.float32]:
    """A picture `(1, 3, H, W)` with smooth parts and edges, which int8 is made for, and not noise."""
    y, x = np.mgrid[:height, :width] / 32.0
    planes = np.stack([np.sin(x + 0.3 * y), np.cos(y - 0.2 * x), np.sign(np.sin(0.7 * x) * np.sin(0.6 * y))])
    return (0.5 + 0.4 * planes[None]).astype(np.float32)
