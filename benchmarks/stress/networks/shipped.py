"""Runs the shipped networks in onnxruntime and the ONNX reference, exposes inner tensors, and measures differences."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from ciir.benchmarks.stress.case import Found
from ciir.cores import count_available_cores
from ciir.models import cards, catalogue
from ciir.models.sessions import open_session

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray
    from onnx import NodeProto

    from ciir.benchmarks.stress.case import Effort

    Values = NDArray[np.float32]

LEVEL = np.float32(1 / 255)
"""One level of 8 bits."""
UNSEEN = 0.5 / 65535
"""Half a level of 16 bits: two results that differ by less come out as neighbours in any file that we write."""

BATCH = 32
"""Pictures in one run."""
REFERENCE_OPSET = 21
"""The opset that the reference evaluator is given: it lacks DequantizeLinear of 18, which our networks have."""


def read_weights(name: str) -> bytes:
    """Reads the network's `.onnx`."""
    return (catalogue.SHIPPED / f"{name}.onnx").read_bytes()


def read_card(name: str) -> cards.Card:
    """Reads the network's card."""
    return cards.read_card(catalogue.SHIPPED / f"{name}.json")


def is_int8(name: str) -> bool:
    """Returns whether the network's convolutions run in 8 bits."""
    return read_card(name).precision == "int8"


def list_float_networks(effort: Effort) -> Iterator[str]:
    """Yields the networks that compute in float32."""
    return (name for name in effort.models if not is_int8(name))


def list_int8_twins(effort: Effort) -> Iterator[tuple[str, str]]:
    """Yields (float network, its int8 twin) for each int8 network."""
    return ((read_card(name).float_twin, name) for name in effort.models if is_int8(name))


def load_network(name: str, *, threads: int | None = None) -> Callable[[Values], Values]:
    """Loads the network as onnxruntime runs it, `BATCH` pictures at a time: no check, padding, tiles, or clipping."""
    session = open_session(read_weights(name), threads or count_available_cores(), is_int8=is_int8(name))

    def run(images: Values) -> Values:
        outputs = [session.run(None, {"image": part})[0] for part in split_batch(images)]
        return np.concatenate(outputs)

    return run


def load_reference(name: str) -> Callable[[Values], Values]:
    """Loads the network as the ONNX package's reference evaluator computes it, in numpy, node by node."""
    import onnx
    from onnx.reference import ReferenceEvaluator
    from onnx.version_converter import convert_version

    evaluator = ReferenceEvaluator(convert_version(onnx.load_from_string(read_weights(name)), REFERENCE_OPSET))

    def run(images: Values) -> Values:
        outputs = (cast("list[Values]", evaluator.run(None, {"image": part})) for part in split_batch(images))
        return np.concatenate([output for (output,) in outputs])

    return run


def split_batch(images: Values) -> Iterator[Values]:
    """Yields `(N, C, H, W)`, `BATCH` pictures at a time, so that memory doesn't grow with their number."""
    return (images[first : first + BATCH] for first in range(0, len(images), BATCH))


def rms(values: NDArray[np.floating]) -> Values:
    """Returns the root mean square of each picture of `(N, C, H, W)`, `(N,)`, in 64 bits, because squares of denormals
    vanish in 32.
    """
    return np.asarray(np.sqrt(np.mean(np.square(values, dtype=np.float64), axis=(1, 2, 3))), np.float32)


def peak(values: NDArray[np.floating]) -> Values:
    """Returns the largest absolute value of each picture of `(N, C, H, W)`, `(N,)`."""
    return np.asarray(np.abs(values).max(axis=(1, 2, 3)), np.float32)


def downsample(images: Values) -> Values:
    """Returns the mean of each 2x2, `(N, C, 2H, 2W)` -> `(N, C, H, W)`: the view of lens cells twice as large."""
    count, channels, height, width = images.shape
    return np.asarray(images.reshape(count, channels, height // 2, 2, width // 2, 2).mean(axis=(3, 5)))


def find_worst(what: str, bound: float, values: Values, names: Sequence[str]) -> Found:
    """Returns the largest of `values` `(N,)`, or the first NaN, with the name of its input."""
    index = int(np.argmax(values))  # NaN counts as the largest
    return Found(what, bound, float(values[index]), names[index])


def bound_difference(what: str, name: str, difference: Values, names: Sequence[str], *, int8_rms: float) -> Found:
    """Compares differences `(N, C, H, W)` with `UNSEEN` or, for an int8 network, their RMS with `int8_rms` levels."""
    if is_int8(name):
        return find_worst(f"{name}: {what}, RMS, levels", int8_rms, rms(difference) / LEVEL, names)
    return find_worst(f"{name}: {what}, worst value", UNSEEN, peak(difference), names)


def list_nodes(network: bytes) -> list[NodeProto]:
    """Returns the graph's nodes, in order."""
    import onnx

    return list(onnx.load_from_string(network).graph.node)


def expose_tensors(
    network: bytes, names: Sequence[str], *, is_int8: bool = False
) -> Callable[[Values], dict[str, NDArray[np.generic]]]:
    """Returns a function that runs the network with the tensors `names` as outputs in addition to its own."""
    import onnx

    model = onnx.load_from_string(network)
    model.graph.output.extend(onnx.ValueInfoProto(name=name) for name in names)
    session = open_session(model.SerializeToString(), count_available_cores(), is_int8=is_int8)

    def run(images: Values) -> dict[str, NDArray[np.generic]]:
        return dict(zip(names, session.run(list(names), {"image": images}), strict=True))

    return run
