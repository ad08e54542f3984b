import re

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from torch.nn import functional

from ciir.training.losses import perceptual
from ciir.training.losses.perceptual import Vgg, VggContent

TINY = (4, "pool", 6, 8)
"""A network with VGG-19's parts: convolutions 0, 3 and 5 of `features`."""


def rand(*shape, seed=0):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def weights(tmp_path):
    """A file as torchvision writes them, with a classifier that is to be ignored."""
    state = {}
    for index, (inputs, outputs) in {0: (3, 4), 3: (4, 6), 5: (6, 8)}.items():
        state[f"features.{index}.weight"] = rand(outputs, inputs, 3, 3, seed=index) - 0.5
        state[f"features.{index}.bias"] = rand(outputs, seed=index) - 0.5
    state["classifier.0.weight"] = rand(2, 2)
    torch.save(state, tmp_path / "vgg.pth")
    return tmp_path / "vgg.pth"


def test_vgg_computes_the_features_before_the_last_activation(weights):
    state, image = torch.load(weights), rand(2, 3, 9, 8)
    x = (image - torch.tensor([0.485, 0.456, 0.406])[:, None, None]) / torch.tensor([0.229, 0.224, 0.225])[
        :, None, None
    ]
    for index in (0, 3, 5):
        x = functional.conv2d(x, state[f"features.{index}.weight"], state[f"features.{index}.bias"], padding=1)
        if index == 0:
            x = functional.max_pool2d(x.relu(), 2)
        elif index == 3:
            x = x.relu()
    got = Vgg(weights, layout=TINY)(image)
    assert (got - x).abs().max() <= 1e-5  # float32, features of about 1
    assert got.min() < 0


def test_vgg_19_is_numbered_as_torchvisions():
    """torchvision's `features` has its convolutions here; conv5_4 is number 34, and its channels halve 4 times."""
    with torch.device("meta"):
        layers = perceptual._make_layers(perceptual.VGG19)
    convolutions = [index for index, layer in enumerate(layers) if isinstance(layer, torch.nn.Conv2d)]
    assert convolutions == [0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28, 30, 32, 34]
    assert len(layers) == 35
    # VGG-19 without its dense layers has 20,024,384 parameters.
    assert sum(weight.numel() for weight in layers.parameters()) == 20_024_384


def test_vgg_is_frozen_and_gradients_flow_only_to_the_output(weights):
    content = VggContent(weights, torch.device("cpu"), layout=TINY)
    output, high = rand(1, 3, 8, 8).requires_grad_(), rand(1, 3, 8, 8, seed=1).requires_grad_()
    loss = content(output, high)
    loss.backward()
    assert loss.item() > 0
    assert output.grad.abs().max() > 0
    assert high.grad is None
    assert not any(weight.requires_grad for weight in content.network.parameters())
    assert content(high, high).item() == 0


def test_a_missing_file_names_the_remedy(tmp_path):
    path = tmp_path / "vgg19.pth"
    with pytest.raises(ValueError, match=re.escape(f"{path}: no such file; give torchvision's vgg19-dcbb9e9d.pth")):
        Vgg(path)


def test_another_networks_file_is_refused(weights, tmp_path):
    with pytest.raises(ValueError, match=r"not VGG-19: features.0.weight is \(4, 3, 3, 3\), not \(64, 3, 3, 3\); give"):
        Vgg(weights)
    torch.save({"conv1.weight": rand(1)}, tmp_path / "resnet.pth")
    torch.save([1], tmp_path / "list.pth")
    for name in ("resnet.pth", "list.pth"):
        with pytest.raises(ValueError, match=r"not VGG-19: features.0.weight is missing, not"):
            Vgg(tmp_path / name, layout=TINY)


@pytest.mark.parametrize("content", [b"", b"not weights", b"PK\x03\x04"])
def test_a_file_of_something_else_is_refused(tmp_path, content):
    path = tmp_path / "vgg.pth"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"not a file of weights; give torchvision's"):
        Vgg(path)


def test_feature_matching_is_the_mean_over_layers_of_any_size():
    output = [torch.ones(1, 2, 4, 4), torch.zeros(1, 3, 2, 2)]
    high = [torch.zeros(1, 2, 4, 4), torch.full((1, 3, 2, 2), 0.5, dtype=torch.bfloat16)]
    loss = perceptual.feature_matching(output, high)
    assert loss.item() == 0.75
    assert loss.dtype == torch.float32
