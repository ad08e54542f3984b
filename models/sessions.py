"""Runs networks on the CPU with onnxruntime, which is imported when the first network is loaded.

At run time only this module imports it; `training.export.export` also does, to check exported networks.
"""

from __future__ import annotations

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.cores import count_available_cores
from ciir.errors import BadCard, UnsuitedProcessor
from ciir.models import cards, processor

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

TILE_PIXELS = 75_000
"""Most input pixels of one tile. This bounds onnxruntime's arena, which grows to the largest run and keeps its size:
about 240 MiB for `paper`, for each call that runs at the same time. Every shipped network upscales a view of 200x200
in one piece and a view of 512x512 in four tiles."""
BATCH_PIXELS = 1 << 13
"""Most input pixels of a batch of pictures. Larger batches don't fit the processor's cache and were never faster."""

SMALLEST = np.float32(1e-20)
"""Smaller input values count as zero. A session's threads flush denormals to zero but the calling thread does not, so
results would depend on which thread computed which part. No 16-bit picture has values that small."""


class OnnxNetwork:
    """A network and its card. Thread-safe: calls share a session and run in parallel."""

    def __init__(self, path: Path, *, threads: int | None = None, emulates_int8: bool = False) -> None:
        """`path`: the card, with the `.onnx` file in the same folder. `threads`: the number of threads for each call;
        None means all cores of the process. `emulates_int8`: whether an int8 network is emulated in float on a
        processor that would compute it wrongly. This is slower than its float twin and meant for measurements.

        Raises `BadCard` if the card is invalid, or the network is missing or not the one that the card describes.
        Raises `UnsuitedProcessor` for an int8 network on such a processor, unless it is emulated.
        """
        self.card = cards.read_card(path)
        if not emulates_int8:
            _check_processor(self.card)
        self.name, self.scale, self.radius = self.card.name, self.card.scale, self.card.radius
        self.threads = threads or count_available_cores()
        self._network = _read_network(path.with_suffix(".onnx"), self.card)
        self._sessions: dict[int, Any] = {}
        self._opening = Lock()

    def run(self, inputs: Mapping[str, NDArray[np.float32]], cores: int | None = None) -> list[NDArray[np.float32]]:
        """Runs the network on inputs by name and returns its outputs in the card's order, not clipped.

        `cores`: the number of cores for this call. None means `threads`; 0 means those of any open session, for inputs
        so small that it doesn't matter. The first call with each number opens a session, which takes 5 to 200 ms. The
        outputs are equal to the bit for any number, except that a float light-field network can differ by 1e-7 on a
        single picture of about 11x11 pixels.
        """
        kept = {name: _clear_denormals(part) for name, part in inputs.items()}
        names = [self.card.output.name, *(tensor.name for tensor in self.card.extra_outputs)]
        session = self._get_session(self.threads if cores is None else cores)
        return [np.asarray(output) for output in session.run(names, kept)]

    def open(self, cores: int) -> None:
        """Opens the session for calls on `cores` cores, so that the first call doesn't have to."""
        self._get_session(cores)

    def _get_session(self, cores: int) -> Any:
        with self._opening:
            cores = cores or next(iter(self._sessions), self.threads)
            if cores not in self._sessions:
                session = open_session(self._network, cores, is_int8=self.card.precision == "int8")
                _check_inputs(session, self.card)
                self._sessions[cores] = session
            return self._sessions[cores]


def _clear_denormals(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns `values` with those closer to zero than `SMALLEST` set to zero; copies them only if there are any."""
    is_small = values != 0
    is_small &= values < SMALLEST
    is_small &= values > -SMALLEST
    return np.where(is_small, np.float32(0), values) if is_small.any() else values


def _check_processor(card: cards.Card) -> None:
    reason = processor.int8_unsupported_reason() if card.precision == "int8" else ""
    if reason:
        remedy = f"use {card.float_twin}, its float twin" if card.float_twin else "use a float network"
        raise UnsuitedProcessor(f"model {card.name}: it computes in int8, but {reason}; {remedy}")


def _check_inputs(session: Any, card: cards.Card) -> None:
    """Raises `BadCard` if the card's inputs differ from the network's, for example free sizes instead of fixed ones."""
    stated = {tensor.name: tensor.shape for tensor in (card.input, *card.extra_inputs)}
    for found in session.get_inputs():
        shape = stated.get(found.name, ())
        fits = len(shape) == len(found.shape) and all(
            not isinstance(size, int) or size == wanted for size, wanted in zip(found.shape, shape, strict=True)
        )
        if not fits:
            raise BadCard(
                f"card {card.name}: states {found.name} as {tuple(shape)}, but the network takes {tuple(found.shape)}; "
                "write network and card with `ciir export FILE.onnx -o DIR`"
            )


def _read_network(path: Path, card: cards.Card) -> bytes:
    """Reads the network in `path` and checks it against its card's hash, which takes 2 ms."""
    try:
        network = path.read_bytes()
    except OSError as error:
        raise BadCard(f"{path}: can't be read ({error.strerror}); install the package again") from error
    found = hashlib.sha256(network).hexdigest()
    if found != card.sha256:
        raise BadCard(f"{path}: sha256 {found[:12]}... is not its card's {card.sha256[:12]}...; install both again")
    return network


def open_session(network: bytes, threads: int, *, is_int8: bool = False) -> Any:
    """Opens an `onnxruntime.InferenceSession` on the CPU for a serialised network, with `threads` threads for each run.

    `is_int8`: whether it has int8 layers. On a processor that doesn't support them they are emulated: without
    onnxruntime's optimisations they stay float layers between QuantizeLinear and DequantizeLinear. The results are the
    same except for the rounding of float32.
    """
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # otherwise it reports each session and keeps a file in ~/.cache
    import onnxruntime  # slow to import, and `ciir models` doesn't need it

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors only; they are raised as exceptions too
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.enable_mem_pattern = False  # it would keep a plan for every input shape
    if is_int8 and processor.int8_unsupported_reason():
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.set_denormal_as_zero", "1")
    # The thread that creates a session flushes denormals to zero from then on, and so does every thread that it starts;
    # numpy then warns and computes differently. So a separate thread creates it. The session's threads flush. A calling
    # thread computes its own share without flushing, which costs nothing as long as the weights have no denormals (see
    # the export).
    with ThreadPoolExecutor(max_workers=1) as own:
        return own.submit(onnxruntime.InferenceSession, network, options, providers=["CPUExecutionProvider"]).result()
