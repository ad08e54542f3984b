"""A light-field network from checkpoint to file and card, in float and in int8."""

import numpy as np
import pytest

NEEDS = "needs the training extra"
pytest.importorskip("torch", reason=NEEDS)
pytest.importorskip("onnxscript", reason=NEEDS)
pytest.importorskip("onnx", reason=NEEDS)
import onnx
import onnxruntime
import torch
from PIL import Image

from ciir.models import cards
from ciir.models.catalogue import SHIPPED
from ciir.models.light_field.network import LightFieldNetwork
from ciir.models.light_field.planes import describe_window
from ciir.models.light_field.windows import select_axis
from ciir.models.sessions import open_session
from ciir.training.data.downscale import KINDS
from ciir.training.data.light_field.layered_scenes import TEXTURE
from ciir.training.evaluation import light_fields
from ciir.training.export import calibration, measure, qdq, to_onnx
from ciir.training.export import inputs as examples
from ciir.training.export.export import compare_with_torch, export_int8, export_network, load_network, simplify_network
from ciir.training.loop import checkpoints, light_field_validation
from ciir.training.networks.light_field import LightFieldGenerator

OPTIONS = {"widths": [8, 16, 16], "width": 16, "depth": 1, "guard": True}


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """An untrained network."""
    torch.manual_seed(6)
    recipe = {"name": "near", "network": "light_field", "options": OPTIONS, "scale": 2, "seed": 0, "light_field": True}
    state = dict.fromkeys(checkpoints.KEYS, 0) | {"recipe": recipe, "commit": "none", "step": 7}
    path = tmp_path_factory.mktemp("run") / "checkpoint.pt"
    checkpoints.save_checkpoint(path, state | {"network": LightFieldGenerator(**OPTIONS).state_dict()})
    return path


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    """5x5 views of one texture, shifted by a pixel from one to the next; large enough to be one of `calibration`'s."""
    folder = tmp_path_factory.mktemp("views")
    texture = np.random.default_rng(1).integers(0, 256, (TEXTURE + 8, TEXTURE + 8, 3), np.uint8)
    for v in range(5):
        for u in range(5):
            Image.fromarray(texture[v : v + TEXTURE, u : u + TEXTURE]).save(folder / f"view_{v}_{u}.png")
    return folder


@pytest.fixture(scope="module")
def exported(checkpoint, views, tmp_path_factory):
    return export_network(checkpoint, tmp_path_factory.mktemp("shipped"), accuracy_on=[views])


def test_the_card(exported, views):
    card = cards.read_card(exported)
    assert card.is_light_field
    assert card.planes == 8
    assert [tensor.name for tensor in card.extra_inputs] == ["around", "down", "across", "window"]
    assert (card.name, card.scale, card.radius, card.training.iterations) == ("near", 2, 5 + 2 + 1 + 1 + 1 + 1, 7)
    assert card.protocol == light_fields.PROTOCOL
    network = LightFieldNetwork(exported)
    assert card.accuracy == tuple(light_fields.measure(network, views, degradation=kind).mean for kind in KINDS)
    assert all(0 <= score.fallback <= 1 for score in card.accuracy)
    assert [score.data for score in card.accuracy] == [f"{views.name} 5x5 ({kind})" for kind in KINDS]
    commands = card.command.split("; ")
    assert commands[0] == f"ciir evaluate near --light-field {views.name} --degradation bicubic"
    assert len(commands) == len(card.accuracy)


def test_two_runs_are_those_of_the_recipe(exported, checkpoint, tmp_path):
    state = checkpoints.read_checkpoint(checkpoint)
    twice = tmp_path / "checkpoint.pt"
    checkpoints.save_checkpoint(twice, state | {"recipe": state["recipe"] | {"runs": 2}})
    one, two = cards.read_card(exported), cards.read_card(export_network(twice, tmp_path))
    assert (one.runs, two.runs) == (1, 2)
    assert two.macs_per_output_pixel == 2 * one.macs_per_output_pixel


@pytest.mark.parametrize("name", ["field", "field-quality"])
def test_shipped_cards_count_the_multiply_adds_of_all_runs(name):
    card = cards.read_card(SHIPPED / f"{name}.json")
    network = simplify_network(LightFieldGenerator(**card.training.recipe["options"]))
    assert card.macs_per_output_pixel == card.runs * measure.count_macs(network, card.sizes)


def test_the_network_only_has_the_score_of_the_log(exported, checkpoint, views):
    scores = [
        light_fields.measure(LightFieldNetwork(exported), views, degradation=kind, network_only=True).views[2, 2][0]
        for kind in KINDS
    ]
    network = load_network(checkpoints.read_checkpoint(checkpoint))
    logged = light_field_validation.validate_network(network, light_field_validation.read_light_field(views, 2))
    assert logged == pytest.approx(np.mean(scores), abs=0.005)
    always, never = (
        light_fields.measure(LightFieldNetwork(exported), views, degradation="box", fusion=fusion, network_only=True)
        for fusion in ("always", "never")
    )
    assert always == never


@pytest.mark.parametrize("place", examples.WINDOWS)
def test_the_file_equals_torch(exported, checkpoint, place):
    network = simplify_network(load_network(checkpoints.read_checkpoint(checkpoint)))
    inputs = examples.make_examples(network, 2, 13, 21, place=place)
    with torch.no_grad():
        wanted, uncertainty = network.forward_with_uncertainty(*inputs)
    image, around = (part.numpy() for part in inputs[:2])
    made, found = LightFieldNetwork(exported)(image, around, *(select_axis(*at) for at in place), examples.EXAMPLE)
    np.testing.assert_allclose(made, wanted.clamp(0, 1).numpy(), atol=1e-5)  # float32's rounding, in another order
    np.testing.assert_allclose(found, uncertainty.numpy(), atol=1e-5)


def test_an_export_that_differs_in_one_window_is_refused(exported, checkpoint):
    """Wrong only at the lower border of a grid of three rows, which is one of the windows."""

    class Off(LightFieldGenerator):
        def forward_with_uncertainty(self, image, around, down, across, window):
            is_lower_border = (window[0] == 1) * (window[1] == 0)
            return super().forward_with_uncertainty(image, around, down * (1 + 0.1 * is_lower_border), across, window)

    network = simplify_network(load_network(checkpoints.read_checkpoint(checkpoint)))
    weights = exported.with_suffix(".onnx").read_bytes()
    assert compare_with_torch(network, weights) <= 1e-5
    network.__class__ = Off
    with pytest.raises(ValueError, match="differs from torch"):
        compare_with_torch(network, weights)


def test_operators_are_fused(exported, tmp_path):
    """onnxruntime's blocked kernels take in the ReLUs, and average over patches; the sweep's convolutions, whose
    kernels are selected by the views that are there, and the last layers' stay.
    """
    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    options.log_severity_level = 3
    onnxruntime.InferenceSession(str(exported.with_suffix(".onnx")), options, providers=["CPUExecutionProvider"])
    nodes = onnx.load(tmp_path / "optimised.onnx").graph.node
    kernels = [node.op_type for node in nodes]
    assert kernels.count("Relu") == 0
    assert kernels.count("Transpose") == 9  # of the views, and two in each of the sweep's four filterings
    assert kernels.count("Slice") < 20  # one for each sample of the sweep made loading five times as long
    assert to_onnx.OPSET < 19 or "AveragePool" not in kernels


def test_a_view_alone_is_the_same_to_the_bit_as_among_others(exported):
    """On any number of threads: onnxruntime's sums over channels are not, in the last bits."""
    network = exported.with_suffix(".onnx").read_bytes()
    random = np.random.default_rng(5)
    image, around = (random.random((3, planes, 45, 38), dtype=np.float32) for planes in (3, 25))
    down, across, description = describe_window(select_axis(0, 5), select_axis(3, 5), examples.EXAMPLE, 8)
    window = {"down": down, "across": across, "window": description}
    several = open_session(network, 1).run(None, {"image": image, "around": around} | window)
    one = {"image": image[:1], "around": around[:1]} | window
    for threads in (1, 2, 4):
        for alone, among in zip(open_session(network, threads).run(None, one), several, strict=True):
            np.testing.assert_array_equal(alone[0], among[0])


def test_the_kernels_of_the_sweep_stay_in_float(exported):
    model = onnx.load(exported.with_suffix(".onnx"))
    names = [layer.name for layer in qdq.find_layers(model)]
    layers = ("compare.0", "compare.2", "choose", "single.body.0", "merged", "single.body.4", "single.tail")
    assert names == [f"network.{layer}.weight" for layer in layers]


def check_int8_graph(model):
    """All is read, the first layer's input is joined as codes, and no layer's output is cut and widened again."""
    nodes = model.graph.node
    makers = {output: node.op_type for node in nodes for output in node.output}
    read = {name for node in nodes for name in node.input} | {output.name for output in model.graph.output}
    assert {output for node in nodes for output in node.output} <= read
    assert "image" not in {name for node in nodes if node.op_type == "Concat" for name in node.input}
    assert "Slice" not in {makers[node.input[0]] for node in nodes if node.name.endswith("_wide")}


def test_int8(checkpoint, exported, views, tmp_path, monkeypatch):
    monkeypatch.setattr(calibration, "SCENES", ["vase"])
    monkeypatch.setattr(calibration, "LIGHT_FIELDS", 1)
    monkeypatch.setattr(calibration, "BATCHES", 1)
    monkeypatch.setattr(calibration, "SIDE", 32)
    path = export_int8(checkpoint, tmp_path, calibrate=[views], accuracy_on=[views])
    card, twin = cards.read_card(path), cards.read_card(exported)
    assert (card.name, card.precision, card.float_twin) == ("near-int8", "int8", "near")
    assert (card.extra_inputs, card.radius) == (twin.extra_inputs, twin.radius)
    assert card.parameters == twin.parameters
    assert card.training.recipe["int8"] == {"calibrate": [views.name], "float_layers": []}
    for ours, theirs in zip(card.accuracy, twin.accuracy, strict=True):
        assert ours.psnr == pytest.approx(theirs.psnr, abs=0.2)
    random = np.random.default_rng(2)
    image, around = (random.random((1, planes, 20, 30), dtype=np.float32) for planes in (3, 25))
    inputs = (image, around, select_axis(0, 5), select_axis(3, 5), examples.EXAMPLE)
    (made, uncertainty), (wanted, exact) = (
        LightFieldNetwork(card, emulates_int8=True)(*inputs) for card in (path, exported)
    )
    difference = np.abs(made - wanted)
    np.testing.assert_allclose(uncertainty, exact, atol=1e-6)
    check_int8_graph(onnx.load(path.with_suffix(".onnx")))
    assert 0 < difference.mean() < 0.02  # in noise two planes suit equally in places, and the other one is chosen
