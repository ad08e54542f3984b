"""Networks from the literature: published sizes, pictures of any size, ONNX."""

import numpy as np
import pytest

NEEDS = "needs the training extra"
pytest.importorskip("torch", reason=NEEDS)
pytest.importorskip("onnxscript", reason=NEEDS)
import torch
from torch import nn

from ciir.models.sessions import open_session
from ciir.training.export import to_onnx
from ciir.training.networks import NETWORKS, make_network
from ciir.training.networks.batch_norm import fold_batch_norm
from ciir.training.networks.collapsible import collapse

SMALL = {
    "compact": {"widths": [8, 8]},
    "ensemble": {"widths": [8, 8]},
    "lite": {"blocks": 2, "channels": 8},
    "srgan": {"blocks": 2, "channels": 8},
    "srcnn": {},
    "fsrcnn": {},
    "vdsr": {"layers": 4, "channels": 8},
    "rdn": {"blocks": 2, "layers": 2, "growth": 8, "base": 8},
    "rrdb": {"blocks": 1, "channels": 8, "growth": 4},
    "sparse_camera": {},
}
"""Options for small networks."""
CASES = [
    *((name, {**options, "scale": scale}) for name, options in SMALL.items() if name != "lite" for scale in (2, 4)),
    ("compact", {**SMALL["compact"], "guard": True}),
    ("lite", SMALL["lite"]),
    ("lite", {**SMALL["lite"], "batch_norm": True}),
]
each_network = pytest.mark.parametrize(("name", "options"), CASES, ids=str)


def weights(network: nn.Module) -> int:
    """Entries of all kernels that are trained, without biases and slopes: what the Y networks' papers count."""
    return sum(p.numel() for p in network.parameters() if p.ndim == 4 and p.requires_grad)


def parameters(network: nn.Module) -> int:
    return sum(p.numel() for p in network.parameters())


def settled(network: nn.Module) -> nn.Module:
    """In evaluation mode, with statistics and biases that are not those of the start."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for parameter in network.parameters():
            if parameter.requires_grad and parameter.ndim == 1:
                parameter.add_(0.1 * torch.rand(parameter.shape, generator=generator))
    for _ in range(3):
        network.train()(torch.rand(2, 3, 9, 11, generator=generator))
    return network.eval()


def test_every_network_is_tested():
    assert SMALL.keys() | {"light_field"} == NETWORKS.keys()  # which takes more than a picture: see test_light_field


@each_network
def test_sizes_and_values(name, options):
    torch.manual_seed(0)
    network = make_network(name, options)
    assert network.scale == options.get("scale", 2)
    network.train()(torch.rand(2, 3, 8, 8))
    network.eval()
    for height, width in ((1, 1), (7, 5), (9, 16)):
        with torch.no_grad():
            output = network(torch.rand(2, 3, height, width))
        assert output.shape == (2, 3, network.scale * height, network.scale * width)
        assert torch.isfinite(output).all()
        assert output.abs().max() < 50  # an untrained network may be far off, but nothing in it has grown


@pytest.mark.parametrize(("name", "options"), [case for case in CASES if case[1].get("scale") != 4], ids=str)
def test_onnx_computes_the_same(name, options):
    """At one pixel too, and at an odd size, to the tolerance of the export."""
    torch.manual_seed(0)
    network = collapse(settled(make_network(name, options)))
    session = open_session(to_onnx.convert_network(fold_batch_norm(network), network.scale), threads=1)
    for size in ((1, 1), (7, 5)):
        images = torch.rand(2, 3, *size)
        with torch.no_grad():
            want = network(images).numpy()
        (got,) = session.run(None, {to_onnx.INPUT: images.numpy()})
        np.testing.assert_allclose(got, want, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "options", "published"),
    [
        ("srcnn", {"colours": 1}, 57_184),  # Dong et al., ECCV 2016, table 1: SRCNN-Ex
        ("fsrcnn", {"colours": 1}, 12_464),  # the same table
        ("vdsr", {"colours": 1}, 664_704),  # 665 K in CARN's table (Ahn et al., ECCV 2018)
    ],
)
def test_weights_of_networks_on_y(name, options, published):
    assert weights(make_network(name, options)) == published


@pytest.mark.parametrize(
    ("name", "options", "count", "published"),
    [
        ("rdn", {"scale": 2}, 22_123_395, "22.12"),
        ("rdn", {"scale": 4}, 22_271_107, "22.27"),
        ("rrdb", {"scale": 4}, 16_697_987, "16.70"),  # BasicSR's count of ESRGAN
        ("lite", {}, 520_515, "0.52"),
    ],
)
def test_parameters_of_networks_on_rgb(name, options, count, published):
    with torch.device("meta"):
        network = make_network(name, options)
    assert parameters(network) == count
    assert f"{count / 1e6:.2f}" == published


@pytest.mark.parametrize("blocks", [3, 6, 16])
def test_the_papers_generator_keeps_its_weights_names(blocks):
    """Checkpoints hold them; the published counts are 299, 521 and 1259 thousand."""
    network = make_network("lite", {"blocks": blocks})
    count = 3 * 64 * 9 + 64 + (2 * blocks + 2) * (64 * 64 * 9 + 64) + 64 * 3 * 9 + 3
    assert parameters(network) == count
    assert count // 1000 == {3: 298, 6: 520, 16: 1259}[blocks]
    inner = [f"blocks.{i}.{part}" for i in range(blocks) for part in ("first", "second")]
    layers = ["head", *inner, "body_last", "upscaled", "tail"]
    assert list(network.state_dict()) == [f"{layer}.{kind}" for layer in layers for kind in ("weight", "bias")]


@pytest.mark.parametrize(("name", "options"), [("lite", {"batch_norm": True}), ("srgan", {})])
def test_folding_leaves_plain_convolutions_that_compute_the_same(name, options):
    torch.manual_seed(0)
    network = settled(make_network(name, {"blocks": 2, "channels": 8, **options}))
    plain = fold_batch_norm(network)
    assert not any(isinstance(module, nn.BatchNorm2d) for module in plain.modules())
    assert any(isinstance(module, nn.BatchNorm2d) for module in network.modules())
    image = torch.rand(2, 3, 9, 13)
    with torch.no_grad():
        assert (plain(image) - network(image)).abs().max() <= 1e-5  # float32, values of about 1


@pytest.mark.parametrize("scale", [2, 4])
def test_the_sparse_camera_deconvolution_is_centred(scale):
    """Its bilinear kernel reproduces a ramp at the samples' exact places, so the support has no offset."""
    tail = make_network("sparse_camera", {"scale": scale}).tail
    taps = 1 - ((torch.arange(2 * scale) + 0.5) / scale - 1).abs()
    kernel = torch.zeros_like(tail.weight)
    kernel[0, 0] = torch.outer(taps, taps)
    with torch.no_grad():
        tail.weight.copy_(kernel)
        tail.bias.zero_()
        ramp = torch.arange(8.0).expand(1, 32, 8, 8)
        got = tail(ramp)[0, 0, scale * 4, scale:-scale]
    want = (torch.arange(8 * scale) + 0.5) / scale - 0.5
    assert (got - want[scale:-scale]).abs().max() <= 1e-5


@pytest.mark.parametrize(("name", "scale"), [("srgan", 3), ("rdn", 8), ("rrdb", 1), ("sparse_camera", 3)])
def test_a_scale_that_a_network_cannot_have(name, scale):
    with pytest.raises(ValueError, match=f"scale: .*{scale}"):
        make_network(name, {"scale": scale})
