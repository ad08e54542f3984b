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
from ciir.models.catalogue import SHIPPED
from ciir.models.single.network import SingleImageNetwork
from ciir.training.evaluation.pictures import score
from ciir.training.export import to_onnx
from ciir.training.export.export import compare_with_torch, export_network, load_network, simplify_network
from ciir.training.loop import train
from ciir.training.networks import make_network
from ciir.training.networks.collapsible import CollapsibleConv


@pytest.fixture(scope="module")
def checkpoint(recipe, tmp_path_factory):
    path = train.train(recipe, tmp_path_factory.mktemp("run"))
    state = torch.load(path, weights_only=True)
    state["network"]["head.weight"][0, 0, 0, :] = torch.tensor([1e-40, -1e-13, 1e-11])
    torch.save(state, path)
    return path


@pytest.fixture(scope="module")
def exported(checkpoint, recipe, tmp_path_factory):
    return export_network(checkpoint, tmp_path_factory.mktemp("shipped"), accuracy_on=[Path(recipe.validate)])


def test_the_card(exported, recipe):
    card = cards.read_card(exported)
    assert exported.name == "tiny.json"
    assert (card.name, card.scale, card.radius) == ("tiny", 2, 1 + 2 + 1 + 1)
    assert card.parameters == 3 * 8 * 9 + 8 + 4 * (8 * 8 * 9 + 8) + 8 * 3 * 9 + 3
    assert card.training.iterations == 3
    assert (card.training.recipe["train"], card.training.recipe["validate"]) == ("train", "pairs")
    assert str(Path(recipe.train).parent) not in exported.read_text()
    assert card.command == "ciir evaluate tiny pairs"
    assert "LR: as given in the folder" in card.protocol
    assert [score.data for score in card.accuracy] == ["pairs"]
    assert card.accuracy[0] == score(SingleImageNetwork(exported), Path(recipe.validate))


def test_pictures_without_low_resolution_pairs_are_degraded(checkpoint, recipe, tmp_path):
    folder = Path(recipe.train)
    card = cards.read_card(export_network(checkpoint, tmp_path, accuracy_on=[folder], degradation="box"))
    assert card.accuracy == (score(SingleImageNetwork(tmp_path / "tiny.json"), folder, degradation="box"),)
    assert card.command == "ciir evaluate tiny train --degradation box"
    assert "LR: box, to 8 bits" in card.protocol


def test_a_card_without_scores_has_no_protocol(checkpoint, tmp_path):
    card = cards.read_card(export_network(checkpoint, tmp_path))
    assert (card.accuracy, card.protocol, card.command) == ((), "", "")


def test_the_file(exported):
    assert sorted(path.name for path in exported.parent.iterdir()) == ["tiny.json", "tiny.onnx"]
    model, card = onnx.load(exported.with_suffix(".onnx")), cards.read_card(exported)
    assert model.opset_import[0].version == card.opset
    for value, tensor in ((model.graph.input[0], card.input), (model.graph.output[0], card.output)):
        assert value.name == tensor.name
        dims = [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
        assert tuple(dims) == tensor.shape
    assert str(Path.cwd()) not in str(model)


def test_no_weight_is_denormal_or_near_it(checkpoint):
    state = torch.load(checkpoint, weights_only=True)
    row = simplify_network(load_network(state)).head.weight[0, 0, 0]
    assert torch.equal(row, torch.tensor([0.0, 0.0, 1e-11]))
    for path in SHIPPED.glob("*.onnx"):
        for tensor in onnx.load(path).graph.initializer:
            values = np.abs(onnx.numpy_helper.to_array(tensor))
            assert not ((values > 0) & (values < 1e-12)).any()


@pytest.mark.parametrize("size", [(8, 8), (9, 13), (31, 18)])  # smaller ones are padded before they reach it
def test_the_file_equals_torch(exported, checkpoint, size):
    network = simplify_network(load_network(torch.load(checkpoint, weights_only=True)))
    images = np.random.default_rng(2).random((2, 3, *size), dtype=np.float32)
    with torch.no_grad():
        want = network(torch.from_numpy(images)).clamp(0, 1).numpy()
    np.testing.assert_allclose(SingleImageNetwork(exported)(images), want, atol=1e-5)


def test_an_export_that_differs_is_refused(exported, checkpoint):
    network = simplify_network(load_network(torch.load(checkpoint, weights_only=True)))
    weights = exported.with_suffix(".onnx").read_bytes()
    assert compare_with_torch(network, weights) <= 1e-5
    with torch.no_grad():
        network.tail.bias += 1e-3
    with pytest.raises(ValueError, match="differs from torch"):
        compare_with_torch(network, weights)


def test_an_export_prints_nothing_and_is_deterministic(exported, checkpoint, capfd):
    network = simplify_network(load_network(torch.load(checkpoint, weights_only=True)))
    assert to_onnx.convert_network(network, 2) == exported.with_suffix(".onnx").read_bytes()
    assert capfd.readouterr() == ("", "")


def test_branches_and_batch_normalisation_are_folded(tmp_path):
    torch.manual_seed(3)
    for name, options, parameters in (
        ("compact", {"widths": [8]}, 3 * 8 * 9 + 8 + 8 * 12 * 9 + 12),
        ("lite", {"blocks": 1, "channels": 8, "batch_norm": True}, 3 * 8 * 9 + 8 + 4 * (8 * 8 * 9 + 8) + 8 * 3 * 9 + 3),
    ):
        network = make_network(name, options).eval()
        folded = simplify_network(network)
        assert sum(weight.numel() for weight in folded.parameters() if weight.requires_grad) == parameters
        assert not any(isinstance(module, (torch.nn.BatchNorm2d, CollapsibleConv)) for module in folded.modules())
        image = torch.rand(1, 3, 9, 11)
        with torch.no_grad():  # float32's rounding, in another order
            torch.testing.assert_close(folded(image), network(image), atol=1e-5, rtol=0)


class Fixed(torch.nn.Module):
    def forward(self, image):
        return torch.nn.functional.interpolate(image.reshape(image.shape[0], 3, 24, 20), scale_factor=2.0)


def test_a_network_whose_sizes_are_fixed_is_refused():
    network = Fixed().eval()
    with pytest.raises(ValueError, match="its sizes aren't free") as caught:
        compare_with_torch(network, to_onnx.convert_network(network, 2))
    assert "\n" not in str(caught.value)


def test_a_name_in_place_of_the_recipes(checkpoint, tmp_path):
    assert cards.read_card(export_network(checkpoint, tmp_path, name="other")).name == "other"
    with pytest.raises(ValueError, match=r"name: '\.\./up': give one of letters"):
        export_network(checkpoint, tmp_path, name="../up")
