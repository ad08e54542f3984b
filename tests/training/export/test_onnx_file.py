import hashlib
from pathlib import Path

import numpy as np
import pytest

NEEDS = "needs the training extra"
for package in ("torch", "onnx"):
    pytest.importorskip(package, reason=NEEDS)
import onnx
from onnx import TensorProto, helper, numpy_helper

from ciir.errors import BadCard
from ciir.models import cards, catalogue
from ciir.models.cards import Sizes
from ciir.models.single.network import SingleImageNetwork
from ciir.training.export.onnx_file import export_onnx

FREE = ("batch", 3, "height", "width")


def write(
    path: Path,
    shape: tuple[str | int, ...] = FREE,
    *,
    factor: int = 2,
    gain: float = 1.0,
    step: int = 1,
    kind: int = TensorProto.FLOAT,
    external: bool = False,
) -> Path:
    """A convolution of 3x3 that keeps pictures, times `gain`, and repeats pixels; sides come out as multiples of
    `step * factor`.
    """
    kernel = np.zeros((3, 3, 3, 3), np.float32)
    kernel[range(3), range(3), 1, 1] = gain
    scales = np.array([1, 1, factor * step, factor * step], np.float32)
    nodes = [
        helper.make_node("AveragePool", ["x"], ["small"], kernel_shape=[step, step], strides=[step, step]),
        helper.make_node("Conv", ["small", "kernel"], ["kept"], pads=[1, 1, 1, 1]),
        helper.make_node("Resize", ["kept", "", "scales"], ["y"], mode="nearest", nearest_mode="floor",
                         coordinate_transformation_mode="asymmetric"),
    ]  # fmt: skip
    out = tuple(side * factor if isinstance(side, int) and i > 1 else side for i, side in enumerate(shape))
    if isinstance(out[2], str):
        out = (*out[:2], "rows", "columns")
    graph = helper.make_graph(
        nodes,
        "others",
        [helper.make_tensor_value_info("x", kind, shape)],
        [helper.make_tensor_value_info("y", kind, out)],
        [numpy_helper.from_array(kernel, "kernel"), numpy_helper.from_array(scales, "scales")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path, save_as_external_data=external, size_threshold=0)
    return path


@pytest.mark.parametrize(("shape", "external"), [(FREE, False), ((1, *FREE[1:]), False), (FREE, True)])
def test_the_network_and_its_card(tmp_path: Path, shape: tuple[str | int, ...], external: bool) -> None:
    path = export_onnx(write(tmp_path / "a.onnx", shape, external=external), tmp_path / "out", name="b")
    card = cards.read_card(path)
    assert (card.name, card.scale, card.opset, card.sizes) == ("b", 2, 17, Sizes())
    assert card.input.shape == (shape[0], 3, "height", "width")
    assert (card.parameters, card.macs_per_output_pixel) == (81 + 4, 81 / 4)
    (tmp_path / "a.onnx").unlink()
    images = np.random.default_rng(0).random((3, 3, 9, 14), np.float32)
    made = SingleImageNetwork(path)(images)
    np.testing.assert_allclose(made, images.repeat(2, 2).repeat(2, 3), atol=1e-6)


def test_sides_that_must_be_multiples_are_found(tmp_path: Path) -> None:
    path = export_onnx(write(tmp_path / "a.onnx", step=4, factor=3), tmp_path / "out")
    card = cards.read_card(path)
    assert (card.scale, card.sizes) == (3, Sizes(8, 4))
    assert SingleImageNetwork(path)(np.ones((1, 3, 9, 14), np.float32)).shape == (1, 3, 27, 42)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shape": (1, 3, 64, 48)}, r"takes only pictures of 64x48 pixels; export it with free height and width"),
        ({"shape": ("batch", 1, "height", "width")}, "takes x tensor.float. .*; give a network of RGB pictures"),
        ({"kind": TensorProto.FLOAT16}, "takes x tensor.float16. .*; give a network of RGB|can't open it"),
        ({"factor": 1}, "doesn't upscale; give a network that does"),
        (
            {"gain": 255.0},
            r"a mean of 127 from one with a mean of 0.5; give a network that takes and makes RGB in \[0, 1\]",
        ),
    ],
)
def test_networks_that_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        export_onnx(write(tmp_path / "a.onnx", **options), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_files_that_are_no_networks(tmp_path: Path) -> None:
    file = tmp_path / "a.onnx"
    file.write_bytes(b"no ONNX")
    with pytest.raises(ValueError, match=r"not an ONNX file; give one written by torch.onnx.export"):
        export_onnx(file, tmp_path / "out")
    write(file, external=True)
    next(path for path in tmp_path.iterdir() if path != file).unlink()
    with pytest.raises(ValueError, match=r"its weights can't be read .*; put their file next to it"):
        export_onnx(file, tmp_path / "out")


def test_a_card_that_states_other_sizes_is_refused_in_one_line(tmp_path: Path) -> None:
    path = export_onnx(write(tmp_path / "a.onnx"), tmp_path / "out")
    text = path.read_text()
    made = write(tmp_path / "out" / "a.onnx", (1, 3, 64, 64)).read_bytes()
    path.write_text(text.replace(cards.read_card(path).sha256, hashlib.sha256(made).hexdigest()))
    with pytest.raises(BadCard, match=r"card a: states x as \('batch', .*, but the network takes \(1, 3, 64, 64\)"):
        SingleImageNetwork(path)(np.ones((1, 3, 64, 64), np.float32))


def test_the_error_names_the_export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CIIR_MODELS", str(tmp_path))
    write(tmp_path / "mine.onnx")
    for name in ("mine", "mine.onnx"):
        with pytest.raises(catalogue.UnknownModel, match=r"mine.onnx has no card mine.json next to it: .*ciir export"):
            catalogue.load_upscaler(name)
    export_onnx(tmp_path / "mine.onnx", tmp_path)
    catalogue._read_networks.cache_clear()
    with pytest.raises(catalogue.UnknownModel, match=r"no 'mine.onnx' here; give one of .*\bmine\b.*nearest$"):
        catalogue.load_upscaler("mine.onnx")
    catalogue._read_networks.cache_clear()


def test_a_network_that_mixes_the_pictures_of_a_batch_takes_one_at_a_time(tmp_path: Path) -> None:
    path = write(tmp_path / "a.onnx")
    model = onnx.load(path)
    model.graph.node[0].input[0] = "mixed"
    mean = helper.make_node("ReduceMean", ["x"], ["mean"], axes=[0])
    model.graph.node.insert(0, helper.make_node("Mean", ["x", "mean"], ["mixed"]))  # of one picture it is the picture
    model.graph.node.insert(0, mean)
    onnx.save(model, path)
    path = export_onnx(path, tmp_path / "out")
    assert cards.read_card(path).input.shape[0] == 1
    images = np.random.default_rng(0).random((2, 3, 9, 14), np.float32)
    np.testing.assert_allclose(SingleImageNetwork(path)(images), images.repeat(2, 2).repeat(2, 3), atol=1e-6)
