"""The shipped networks as cases want them: with onnxruntime and nothing around it, and with a look inside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ciir.models import cards, catalogue
from ciir.models.sessions import count_available_cores, open_session

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray
    from onnx import NodeProto

    from ciir.benchmarks.stress.case import Effort

    Values = NDArray[np.float32]

LEVEL = np.float32(1 / 255)
"""One of the 8-bit levels."""
UNSEEN = 0.5 / 65535
"""Half a level of 16 bits: two results that differ by less come out as neighbours in any file that we write."""

TOGETHER = 32
"""Pictures in one run."""


def weights(name: str) -> bytes:
    """The network's `.onnx`."""
    return (catalogue.SHIPPED / f"{name}.onnx").read_bytes()


def card(name: str) -> cards.Card:
    """The network's card."""
    return cards.read_card(catalogue.SHIPPED / f"{name}.json")


def is_int8(name: str) -> bool:
    """Whether the network's convolutions run in 8 bits."""
    return card(name).precision == "int8"


def floats(effort: Effort) -> Iterator[str]:
    """The networks that compute in float32."""
    return (name for name in effort.models if not is_int8(name))


def twins(effort: Effort) -> Iterator[tuple[str, str]]:
    """(float network, its int8 twin) of each int8 one."""
    return ((card(name).float_twin, name) for name in effort.models if is_int8(name))


def raw(name: str, *, threads: int | None = None) -> Callable[[Values], Values]:
    """The network as onnxruntime runs it, `TOGETHER` pictures at a time: no check, padding, tiles, or clipping."""
    session = open_session(weights(name), threads or count_available_cores())

    def run(images: Values) -> Values:
        outputs = [session.run(None, {"image": part})[0] for part in parts(images)]
        return np.concatenate(outputs)

    return run


def torch_twin(name: str) -> Callable[[Values], Values]:
    """The same graph in torch (`in_torch`), which must be there; on one core, as two wait for each other longer than
    these small pictures take where other work runs beside.
    """
    import torch

    from ciir.benchmarks.stress.networks import in_torch

    network = in_torch.network(weights(name))

    def run(images: Values) -> Values:
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            with torch.no_grad():
                return np.concatenate([network(torch.from_numpy(part)).numpy() for part in parts(images)])
        finally:
            torch.set_num_threads(threads)

    return run


def parts(images: Values) -> Iterator[Values]:
    """`(N, C, H, W)`, `TOGETHER` pictures at a time, so that memory doesn't grow with their number."""
    return (images[first : first + TOGETHER] for first in range(0, len(images), TOGETHER))


def rms(values: NDArray[np.floating]) -> Values:
    """Root mean square of each picture of `(N, C, H, W)`, `(N,)`; in 64 bits, as squares of denormals vanish in 32."""
    return np.asarray(np.sqrt(np.mean(np.square(values, dtype=np.float64), axis=(1, 2, 3))), np.float32)


def peak(values: NDArray[np.floating]) -> Values:
    """Largest absolute value of each picture of `(N, C, H, W)`, `(N,)`."""
    return np.asarray(np.abs(values).max(axis=(1, 2, 3)), np.float32)


def box(images: Values) -> Values:
    """`(N, C, 2H, 2W)` -> `(N, C, H, W)`, the mean of each 2x2: what a lens cell twice as large sees."""
    count, channels, height, width = images.shape
    return np.asarray(images.reshape(count, channels, height // 2, 2, width // 2, 2).mean(axis=(3, 5)))


def worst(values: Values, names: Sequence[str]) -> tuple[float, str]:
    """The largest of `(N,)`, or the first NaN, and the name of its input."""
    index = int(np.argmax(values))  # NaN counts as the largest
    return float(values[index]), names[index]


def nodes(network: bytes) -> list[NodeProto]:
    """The graph's nodes, in order."""
    import onnx

    return list(onnx.load_from_string(network).graph.node)


def looking_inside(network: bytes, names: Sequence[str]) -> Callable[[Values], dict[str, NDArray[np.generic]]]:
    """The network with the tensors `names` as outputs beside its own."""
    import onnx

    model = onnx.load_from_string(network)
    model.graph.output.extend(onnx.ValueInfoProto(name=name) for name in names)
    session = open_session(model.SerializeToString(), count_available_cores())

    def run(images: Values) -> dict[str, NDArray[np.generic]]:
        return dict(zip(names, session.run(list(names), {"image": images}), strict=True))

    return run
