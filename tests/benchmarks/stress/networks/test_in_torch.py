import numpy as np
import pytest

from ciir.benchmarks.stress.networks import in_torch, shipped
from ciir.models import catalogue

torch = pytest.importorskip("torch", reason="needs the training extra")
onnx = pytest.importorskip("onnx", reason="needs the training extra")


def noise(*shape):
    return np.random.default_rng(5).random(shape, dtype=np.float32)


@pytest.mark.parametrize(
    "name",
    [
        entry.name
        for entry in catalogue.list_entries()
        if entry.card and not entry.unsupported_reason and not entry.is_light_field
    ],
)
def test_it_computes_what_onnxruntime_does(name):
    images = noise(2, 3, 9, 14)
    difference = shipped.torch_twin(name)(images) - shipped.raw(name)(images)
    if shipped.is_int8(name):  # a code may round the other way: see signals.ROUNDED_AWAY
        assert shipped.rms(difference).max() < 1 * shipped.LEVEL
    else:
        assert np.abs(difference).max() < shipped.UNSEEN


def test_torch_can_differentiate_it():
    network = in_torch.network(shipped.weights("fast"))
    image = torch.from_numpy(noise(1, 3, 8, 8)).requires_grad_()
    (gradient,) = torch.autograd.grad(network(image).sum(), image)
    assert gradient.shape == image.shape
    assert gradient.abs().min() > 0


def graph(kind, **attributes):
    node = onnx.helper.make_node(kind, ["image"], ["out"], **attributes)
    ends = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None) for name in ("image", "out")]
    made = onnx.helper.make_graph([node], "g", ends[:1], ends[1:])
    return onnx.helper.make_model(made).SerializeToString()


def test_unknown_operators_are_named():
    with pytest.raises(ValueError, match="Sigmoid"):
        in_torch.network(graph("Sigmoid"))


def test_unknown_ways_of_known_operators_are_named():
    network = in_torch.network(graph("DepthToSpace", blocksize=2, mode="DCR"))
    with pytest.raises(ValueError, match="DCR"):
        network(torch.zeros(1, 4, 2, 2))


def test_the_number_of_threads_stays():
    before = torch.get_num_threads()
    shipped.torch_twin("fast")(noise(1, 3, 8, 8))
    assert torch.get_num_threads() == before
