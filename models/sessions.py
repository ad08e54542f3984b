"""Networks on the CPU by onnxruntime, which is imported here and nowhere else, when the first network is opened."""

from __future__ import annotations

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import BadCard, UnsuitedProcessor
from ciir.models import cards, processor

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

WINDOW = 1 << 16
"""Most input pixels of one tile. It bounds the arena, which grows to the largest run and stays: about 210 MiB for
the lite network, for each call that runs at the same time. A 200x200 view still goes whole."""
BATCH = 1 << 13
"""Most input pixels of several pictures in one run: larger batches leave the cache and were never quicker a picture."""

FAINTEST = np.float32(1e-20)
"""Smaller values count as zero. Of what comes near denormals, a session's workers make zeros and a calling thread does
not, so that two runs would differ in which thread did which part. No picture of 16 bits holds any."""


class OnnxNetwork:
    """A network and its card; calls from several threads share a session and run side by side."""

    def __init__(self, path: Path, *, threads: int | None = None) -> None:
        """`path`: the card; its `.onnx` lies beside it. `threads`: for each call, all of the process's cores if None.

        Raises `BadCard` where the card is no card, or the network is missing or not the one that it describes;
        `UnsuitedProcessor` where it is an int8 network and this machine's processor gets those wrong.
        """
        self.card = cards.read_card(path)
        _check_processor(self.card)
        self.name, self.scale, self.radius = self.card.name, self.card.scale, self.card.radius
        self.threads = threads or count_available_cores()
        self._network = _read(path.with_suffix(".onnx"), self.card)
        self._sessions: dict[int, Any] = {}
        self._opening = Lock()

    def run(self, inputs: Mapping[str, NDArray[np.float32]], cores: int | None = None) -> list[NDArray[np.float32]]:
        """The network's outputs, in the card's order, for its inputs by name, as they come.

        `cores`: what this call may take; all of `threads` if None. The first call with each number opens a session,
        which takes 5 to 200 ms. The outputs don't depend on it.
        """
        kept = {name: np.where(np.abs(part) < FAINTEST, np.float32(0), part) for name, part in inputs.items()}
        names = [self.card.output.name, *(tensor.name for tensor in self.card.further_outputs)]
        return [np.asarray(output) for output in self._session(cores or self.threads).run(names, kept)]

    def _session(self, cores: int) -> Any:
        with self._opening:
            if cores not in self._sessions:
                self._sessions[cores] = open_session(self._network, cores)
            return self._sessions[cores]


def count_available_cores() -> int:
    """The cores that this process may use, at least 1."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _check_processor(card: cards.Card) -> None:
    reason = processor.int8_unsupported_reason() if card.precision == "int8" else ""
    if reason:
        remedy = f"use {card.float_twin}, its float twin" if card.float_twin else "use a float network"
        raise UnsuitedProcessor(f"model {card.name}: it computes in int8, and {reason}; {remedy}")


def _read(path: Path, card: cards.Card) -> bytes:
    """The network in `path`, held against its card; hashing takes 2 ms."""
    try:
        network = path.read_bytes()
    except OSError as error:
        raise BadCard(f"{path}: can't be read ({error.strerror}); install the package again") from error
    found = hashlib.sha256(network).hexdigest()
    if found != card.sha256:
        raise BadCard(f"{path}: sha256 {found[:12]}... is not its card's {card.sha256[:12]}...; install both again")
    return network


def open_session(network: bytes, threads: int) -> Any:
    """An `onnxruntime.InferenceSession` on the CPU for a serialised network, with `threads` cores for each run."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # else it tells its maker of each session, and keeps a file in ~/.cache
    import onnxruntime  # slow to start, and `ciir models` needs none of it

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors alone; they arrive as exceptions too
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.enable_mem_pattern = False  # it would keep a plan for each shape that is ever seen
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.set_denormal_as_zero", "1")
    # The thread that makes a session is left flushing denormals to zero, and so is every thread that it starts: numpy
    # then warns and computes differently. So it is a thread of its own. The session's workers flush; a calling thread
    # does its own share without, which costs nothing as long as the weights hold no denormals (see the export).
    with ThreadPoolExecutor(max_workers=1) as own:
        return own.submit(onnxruntime.InferenceSession, network, options, providers=["CPUExecutionProvider"]).result()
