"""Runs that start from an ONNX file: the network computes what the exported one did."""

from dataclasses import replace

import pytest

NEEDS = "needs the training extra"
pytest.importorskip("torch", reason=NEEDS)
pytest.importorskip("onnxscript", reason=NEEDS)
pytest.importorskip("onnx", reason=NEEDS)
import torch

from ciir.training.export import inputs as examples
from ciir.training.export import to_onnx
from ciir.training.export.export import simplify_network
from ciir.training.loop import initial
from ciir.training.loop.initial import load_onnx_weights
from ciir.training.loop.run import Run
from ciir.training.networks import make_network

OPTIONS = {
    "compact": {"widths": [8, 16, 8], "slope": 0.0, "guard": True},
    "ensemble": {"widths": [8, 16, 8], "slope": 0.0, "guard": True},
    "light_field": {"widths": [8, 16, 8], "width": 16, "depth": 1, "guard": True},
}


def make(kind, seed, **options):
    """A network whose weights are all away from those that it starts with."""
    torch.manual_seed(seed)
    network = make_network(kind, OPTIONS[kind] | options).eval()
    with torch.no_grad():
        for weight in network.parameters():
            if weight.requires_grad:
                weight.add_(0.05 * torch.randn_like(weight))
    return network


@pytest.fixture(scope="module", params=list(OPTIONS))
def exported(request, tmp_path_factory):
    """The kind of network, the network, and its file."""
    network = make(request.param, 1)
    path = tmp_path_factory.mktemp("exported") / f"{request.param}.onnx"
    path.write_bytes(to_onnx.convert_network(simplify_network(network), 2))
    return request.param, network, path


@torch.no_grad()
def upscale(network):
    """What it makes of noise, in each kind of window."""
    places = examples.list_windows(network)
    return torch.stack([network(*examples.make_examples(network, 2, 9, 11, place=place)) for place in places])


def assert_alike(made, wanted):
    # The branches' sum is subtracted in float32 and added again.
    torch.testing.assert_close(made, wanted, atol=1e-4, rtol=0)


def test_the_network_computes_what_the_exported_one_does(exported):
    kind, network, path = exported
    other, wanted = make(kind, 2), upscale(network)
    assert (upscale(other) - wanted).abs().max() > 0.01
    branches = {name: value.clone() for name, value in other.named_parameters() if name.endswith(("widen", "narrow"))}
    assert branches
    load_onnx_weights(other, path)
    assert_alike(upscale(other), wanted)
    for name, value in branches.items():
        assert torch.equal(other.get_parameter(name), value)


def test_it_merges_to_the_same_again(exported):
    kind, network, path = exported
    other = make(kind, 3)
    load_onnx_weights(other, path)
    found, wanted = (simplify_network(one) for one in (other, network))
    assert_alike(upscale(found), upscale(wanted))
    for (name, one), (same, two) in zip(found.named_parameters(), wanted.named_parameters(), strict=True):
        assert name == same
        torch.testing.assert_close(one, two, atol=1e-5, rtol=1e-5)


def test_further_layers_start_near_the_identity(exported, monkeypatch):
    kind, network, path = exported
    other = make(kind, 4, widths=[8, 16, 8, 8, 8])
    wanted, before = upscale(network), upscale(other)
    load_onnx_weights(other, path)
    near = (upscale(other) - wanted).abs().mean()
    assert 1e-4 < near < 0.2 * (before - wanted).abs().mean()
    monkeypatch.setattr(initial, "ADDED", 0.0)
    load_onnx_weights(other, path)
    assert_alike(upscale(other), wanted)


def test_another_network_is_refused(exported):
    kind, _, path = exported
    with pytest.raises(ValueError, match=r"initial: .*onnx doesn't hold the weights of .*; name another") as caught:
        load_onnx_weights(make(kind, 2, widths=[8, 16, 12]), path)
    assert "\n" not in str(caught.value)


@torch.no_grad()
def test_an_ensemble_starts_from_one_generator_or_from_as_many(tmp_path):
    generator = make("compact", 1)
    path = tmp_path / "compact.onnx"
    path.write_bytes(to_onnx.convert_network(simplify_network(generator), 2))
    generator.guard = False  # of the sum, where there are several
    ensemble = make("ensemble", 2, guard=False, members=3)
    load_onnx_weights(ensemble, path)
    image = torch.rand(1, 3, 9, 11)
    turned = [generator(image.rot90(k, (2, 3))).rot90(-k, (2, 3)) for k in range(3)]
    assert_alike(ensemble(image), torch.stack(turned).mean(0))
    path.write_bytes(to_onnx.convert_network(simplify_network(ensemble), 2))
    with pytest.raises(ValueError, match="an ensemble of 3 generators, but members is 2; set members = 3"):
        load_onnx_weights(make("ensemble", 2), path)


def test_a_run_starts_from_the_file(exported, recipe):
    kind, network, path = exported
    run = Run(replace(recipe, network=kind, options=OPTIONS[kind], initial=str(path)))
    run.start_from(path)
    for one in (run.network, run.average):
        assert_alike(upscale(one.eval().to(memory_format=torch.contiguous_format)), upscale(network))
