"""int8: the graph, the grids, and the export from checkpoint to `NAME-int8`."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

NEEDS = "needs the training extra"
pytest.importorskip("torch", reason=NEEDS)
pytest.importorskip("onnxscript", reason=NEEDS)
pytest.importorskip("onnx", reason=NEEDS)
import onnx
import torch

from ciir.models import cards
from ciir.models.sessions import open_session
from ciir.models.single.network import SingleImageNetwork
from ciir.training.export import calibration, export, qdq, quantise, to_onnx
from ciir.training.export.export import export_int8, simplify_network
from ciir.training.loop import checkpoints, train
from ciir.training.networks import make_network


@pytest.fixture(scope="module", autouse=True)
def one_scene():
    """Rendering all of them takes 20 seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "SCENES", ["vase"])
        patch.setattr(calibration, "VIEWS", 1)
        yield


@pytest.fixture(scope="module")
def pairs(recipe, one_scene):
    return calibration.make_picture_examples([Path(recipe.train)], 2)


@pytest.fixture(scope="module")
def weights():
    """A compact generator, untrained: interpolation and some noise."""
    torch.manual_seed(5)
    return to_onnx.convert_network(simplify_network(make_network("compact", {"widths": [8, 16]})), 2)


@pytest.fixture(scope="module")
def made(weights, pairs):
    return quantise.quantise_network(weights, pairs)


def run(network, pairs):
    """What a serialised network makes of the first of `pairs`; int8 is emulated where the processor can't."""
    return open_session(network, 1, is_int8=True).run(None, pairs[0].inputs)[0]


def test_a_grid_holds_zero_and_spans_what_it_is_given():
    grid = qdq.Grid.over(-0.5, 2.0)
    assert grid.round(np.float32([0.0])) == 0.0
    values = np.linspace(-0.5, 2.0, 99, dtype=np.float32)
    assert np.abs(grid.round(values) - values).max() <= grid.scale * 0.5001
    np.testing.assert_allclose(grid.round(np.float32([-9, 9])), [-0.5, 2.0], atol=grid.scale)
    assert qdq.Grid.over(0.0, 1.0) == (np.float32(1 / 255), 0)
    assert qdq.Grid.over(0.3, 0.3).zero == 0


def test_a_few_extremes_do_not_make_the_grid_coarse():
    values = np.random.default_rng(0).normal(0, 0.1, 10000).astype(np.float32)
    values[:2] = [-8, 8]
    sample = quantise._Sample(values, -8.0, 8.0)
    chosen, coarse = quantise._choose_grid(sample, quantise._identity), qdq.Grid.over(-8, 8)
    assert chosen.scale < coarse.scale
    assert np.square(chosen.round(values) - values).mean() < np.square(coarse.round(values) - values).mean()


def test_the_grid_before_a_leaky_relu_has_fewer_negative_codes():
    """The slope makes errors of negative values an eighth."""
    values = np.random.default_rng(0).normal(0, 1, 20000).astype(np.float32)
    node = onnx.helper.make_node("LeakyRelu", ["x"], ["y"], alpha=0.125)
    sample = quantise._Sample(values, float(values.min()), float(values.max()))
    assert (
        quantise._choose_grid(sample, quantise._make_leaky(node)).zero
        < quantise._choose_grid(sample, quantise._identity).zero
    )


def test_a_relu_behind_a_layer_that_is_padded(pairs):
    """8 channels become 16 with zeros, and what they make is cut off before the ReLU."""
    torch.manual_seed(5)
    weights = to_onnx.convert_network(simplify_network(make_network("compact", {"widths": [8, 16], "slope": 0.0})), 2)
    grids = quantise.choose_grids(onnx.load_from_string(weights), pairs)
    made = qdq.insert_qdq(onnx.load_from_string(weights), grids).SerializeToString()
    got, want = (run(network, pairs) for network in (made, weights))
    assert np.abs(got - want).max() < 3 / 255


def test_a_bias_with_a_nearly_zero_filter(pairs):
    """Its code stays within 32 bits."""
    network = simplify_network(make_network("compact", {"widths": [8, 16]}))
    with torch.no_grad():
        network.body[2].weight[0], network.body[2].bias[0] = 1e-9, 0.1
    model = onnx.load_from_string(to_onnx.convert_network(network, 2))
    made = qdq.insert_qdq(model, quantise.choose_grids(model, pairs[:1]))
    values = {value.name: onnx.numpy_helper.to_array(value) for value in made.graph.initializer}
    bias = values["body.2.weight_bias_codes"][0] * values["body.2.weight_bias_scales"][0]
    assert bias == pytest.approx(0.1, rel=1e-4)


def test_the_graph(weights, pairs):
    model = onnx.load_from_string(weights)
    layers = qdq.find_layers(model)
    assert [layer.name for layer in layers] == ["body.0.weight", "body.2.weight", "tail.weight"]
    made = qdq.insert_qdq(model, quantise.choose_grids(model, pairs))
    onnx.checker.check_model(made, full_check=True)
    values = {value.name: onnx.numpy_helper.to_array(value) for value in made.graph.initializer}
    codes = [values[f"{layer.name}_8_codes"] for layer in layers]
    assert {array.dtype for array in codes} == {np.dtype(np.int8)}
    for array, layer in zip(codes, layers, strict=True):
        assert (array.shape[0] % qdq.OUTPUTS, array.shape[1] % qdq.INPUTS) == (0, 0)
        scales = values[f"{layer.name}_8_scales"][:, None, None, None]
        of = next(value for value in model.graph.initializer if value.name == layer.name)
        weight = onnx.numpy_helper.to_array(of)
        outputs, inputs = weight.shape[:2]
        assert np.abs(array[:outputs, :inputs] * scales[:outputs] - weight).max() <= scales.max() * 0.5001
        assert not array[outputs:].any()
        assert not array[:, inputs:].any()
    assert {"base.down.weight", "base.across.weight"} <= values.keys()
    assert made.graph.input == model.graph.input
    assert made.graph.output == model.graph.output
    kept = qdq.insert_qdq(model, {}, [layer.name for layer in layers])
    assert kept.SerializeToString() == model.SerializeToString()


class Joined(torch.nn.Module):
    """A layer that reads two others, the second 100 times as small, and something with negative values."""

    scale = 2

    def __init__(self):
        super().__init__()
        self.first, self.second = torch.nn.Conv2d(3, 16, 3, padding=1), torch.nn.Conv2d(3, 5, 3, padding=1)
        self.join, self.last = torch.nn.Conv2d(16 + 5 + 3, 16, 3, padding=1), torch.nn.Conv2d(16, 12, 3, padding=1)
        with torch.no_grad():
            self.second.weight *= 0.01
            self.second.bias *= 0.01
            self.join.weight[:, 16:21] *= 100

    def forward(self, image):
        parts = [torch.relu(self.first(image)), torch.relu(self.second(image)), image - 0.5]
        made = self.last(torch.relu(self.join(torch.cat(parts, 1))))
        return torch.nn.functional.pixel_shuffle(made + image.repeat(1, 4, 1, 1), 2)


def test_joined_outputs_of_layers_keep_their_own_grids(pairs):
    torch.manual_seed(7)
    weights = to_onnx.convert_network(Joined().eval(), 2)
    model = onnx.load_from_string(weights)
    layer = next(layer for layer in qdq.find_layers(model) if layer.name == "join.weight")
    assert list(layer.parts.values()) == [16, 5, 3]
    grids = quantise.choose_grids(model, pairs)
    made = qdq.insert_qdq(model, grids)
    values = {value.name: onnx.numpy_helper.to_array(value) for value in made.graph.initializer}
    assert values["join.weight_8_codes"].shape[1] == 16 + 5 + 3 + 3 + 1  # the negated part too, made up to fours
    wanted, output = (run(network, pairs) for network in (weights, made.SerializeToString()))
    coarse = {name: grids[next(iter(layer.parts))] if name in layer.parts else grid for name, grid in grids.items()}
    worse = run(qdq.insert_qdq(model, coarse).SerializeToString(), pairs)
    error = np.abs(output - wanted).max()
    assert error < 3 / 255
    assert np.abs(worse - wanted).max() > 4 * error
    kept = qdq.insert_qdq(model, grids, ["join.weight"])
    onnx.checker.check_model(kept, full_check=True)
    assert np.abs(run(kept.SerializeToString(), pairs) - wanted).max() < 3 / 255


class ReadTwice(torch.nn.Module):
    """5 channels that are read by a layer, which needs more of them in 8 bits, and joined to its output."""

    scale = 2

    def __init__(self):
        super().__init__()
        self.first, self.second = torch.nn.Conv2d(3, 5, 3, padding=1), torch.nn.Conv2d(5, 16, 3, padding=1)
        self.join, self.last = torch.nn.Conv2d(5 + 16, 16, 3, padding=1), torch.nn.Conv2d(16, 12, 3, padding=1)

    def forward(self, image):
        first = torch.relu(self.first(image))
        joined = torch.cat([first, torch.relu(self.second(first))], 1)
        return torch.nn.functional.pixel_shuffle(self.last(torch.relu(self.join(joined))) + image.repeat(1, 4, 1, 1), 2)


class JoinedTwice(torch.nn.Module):
    """5 channels that are the last ones in the inputs of two layers, each of which needs more of them in 8 bits."""

    scale = 2

    def __init__(self):
        super().__init__()
        self.first, self.second, self.third = (torch.nn.Conv2d(3, width, 3, padding=1) for width in (16, 18, 5))
        self.join, self.other = (torch.nn.Conv2d(width + 5, 12, 3, padding=1) for width in (16, 18))

    def forward(self, image):
        first, second, third = (torch.relu(layer(image)) for layer in (self.first, self.second, self.third))
        made = self.join(torch.cat([first, third], 1)) + self.other(torch.cat([second, third], 1))
        return torch.nn.functional.pixel_shuffle(made + image.repeat(1, 4, 1, 1), 2)


def test_a_layer_that_is_joined_twice(pairs):
    torch.manual_seed(7)
    model = onnx.load_from_string(to_onnx.convert_network(JoinedTwice().eval(), 2))
    assert [list(layer.parts.values()) for layer in qdq.find_layers(model) if layer.parts] == [[16, 5], [18, 5]]
    made = qdq.insert_qdq(model, quantise.choose_grids(model, pairs))
    onnx.checker.check_model(made, full_check=True)
    got, want = (run(one.SerializeToString(), pairs) for one in (made, model))
    assert np.abs(got - want).max() < 6 / 255  # both are rounded before they are added


def test_a_joined_layer_that_is_kept_in_float(pairs):
    torch.manual_seed(7)
    model = onnx.load_from_string(to_onnx.convert_network(ReadTwice().eval(), 2))
    grids = quantise.choose_grids(model, pairs)
    assert list(next(layer for layer in qdq.find_layers(model) if layer.parts).parts.values()) == [5, 16]
    for kept in ("first.weight", "second.weight"):
        onnx.checker.check_model(qdq.insert_qdq(model, grids, [kept]), full_check=True)


@pytest.mark.parametrize("name", ["rrdb", "rdn"])
def test_dense_networks(name, pairs):
    """They join outputs without a ReLU, and what other layers read: such inputs have one grid."""
    options = {"rrdb": {"blocks": 1, "channels": 16, "growth": 8}, "rdn": {"blocks": 1, "layers": 2, "growth": 16}}
    torch.manual_seed(7)
    weights = to_onnx.convert_network(make_network(name, options[name]).eval(), 2)
    model = onnx.load_from_string(weights)
    assert not any(layer.parts for layer in qdq.find_layers(model))
    made = qdq.insert_qdq(model, quantise.choose_grids(model, pairs))
    onnx.checker.check_model(made, full_check=True)
    wanted, output = (run(network, pairs) for network in (weights, made.SerializeToString()))
    assert np.abs(output - wanted).max() < 3 / 255


def test_the_picture_itself_is_not_rounded():
    model = onnx.load_from_string(to_onnx.convert_network(make_network("lite", {"blocks": 1, "channels": 8}).eval(), 2))
    assert "tail.weight" in {value.name for value in model.graph.initializer}
    assert "tail.weight" not in [layer.name for layer in qdq.find_layers(model)]


@pytest.mark.parametrize("shape", [(1, 3, 1, 1), (2, 3, 9, 13), (1, 3, 40, 31)])
def test_int8_is_near_float(weights, made, shape):
    network, kept = made
    images = np.random.default_rng(1).random(shape, dtype=np.float32)
    float_output, output = (
        open_session(w, 1, is_int8=True).run(None, {to_onnx.INPUT: images})[0] for w in (weights, network)
    )
    assert kept == []
    assert output.dtype == np.float32
    assert 0 < np.abs(output - float_output).max() < 0.02  # the change to interpolation is some 0.1, in 256 steps


def test_quantisation_is_deterministic(weights, pairs, made):
    assert quantise.quantise_network(weights, pairs) == made


def test_what_costs_too_much_stays_in_float(weights, pairs, monkeypatch):
    """Made bad on purpose: what the middle layer makes has 3 levels. The truth is what the float network makes."""
    choose, session = quantise.choose_grids, open_session(weights, 1)

    def truth(inputs):
        (output,) = session.run(None, inputs)
        return np.rint(255 * output[0].clip(0, 1).transpose(1, 2, 0)).astype(np.uint8)

    def coarse(model, pairs):
        grids = choose(model, pairs)
        (name,) = (layer.tensors[1] for layer in qdq.find_layers(model) if layer.name == "body.2.weight")
        return grids | {name: qdq.Grid(grids[name].scale * 100, grids[name].zero)}

    pairs = [calibration.Example(inputs, truth(inputs)) for inputs, _ in pairs]
    monkeypatch.setattr(quantise, "choose_grids", coarse)
    made, kept = quantise.quantise_network(weights, pairs)
    assert kept == ["body.2.weight"]
    names = {value.name for value in onnx.load_from_string(made).graph.initializer}
    assert "body.2.weight" in names
    assert "body.2.weight_8_codes" not in names
    monkeypatch.setattr(quantise, "LIMIT", -100.0)
    with pytest.raises(ValueError, match="ship the network as float"):
        quantise.quantise_network(weights, pairs)


def test_from_checkpoint_to_card(recipe, pairs, tmp_path):
    recipe = dataclasses.replace(recipe, network="compact", options={"widths": [8]}, steps=1, validate_every=1)
    checkpoint = train.train(recipe, tmp_path / "run")
    folders = [Path(recipe.train)]
    path = export_int8(checkpoint, tmp_path / "out", calibrate=folders, accuracy_on=[Path(recipe.validate)])
    assert sorted(file.name for file in path.parent.iterdir()) == ["tiny-int8.json", "tiny-int8.onnx"]
    card = cards.read_card(path)
    assert (card.name, card.precision, card.float_twin) == ("tiny-int8", "int8", "tiny")
    assert card.training.recipe["int8"] == {"calibrate": [folders[0].name], "float_layers": []}
    assert (card.parameters, card.radius) == (9 * (3 * 8 + 8 * 12) + 8 + 12, 2)
    assert [score.data for score in card.accuracy] == ["pairs"]
    images = pairs[0].inputs["image"]
    with torch.no_grad():
        wanted = simplify_network(export.load_network(checkpoints.read_checkpoint(checkpoint)))(
            torch.from_numpy(images)
        ).clamp(0, 1)
    assert 0 < np.abs(SingleImageNetwork(path, emulates_int8=True)(images) - wanted.numpy()).max() < 0.01
