"""Pictures labelled by a network, a stand-in that repeats pixels."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
onnx = pytest.importorskip("onnx", reason="needs the training extra")
from onnx import TensorProto, helper
from PIL import Image

from ciir.training.data import labels
from ciir.training.data.crops import Crops
from ciir.training.data.downscale import downscale_picture
from ciir.training.data.pictures import read_rgb


def write_network(path, scale):
    """Repeats each pixel `scale` times along both axes."""
    sizes = helper.make_tensor("scales", TensorProto.FLOAT, [4], [1, 1, scale, scale])
    node = helper.make_node(
        "Resize",
        ["in", "", "scales"],
        ["out"],
        mode="nearest",
        coordinate_transformation_mode="asymmetric",
        nearest_mode="floor",
    )
    given, made = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3, None, None]) for name in ("in", "out"))
    graph = helper.make_graph([node], "repeating", [given], [made], initializer=[sizes])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), path)
    return path


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return write_network(tmp_path_factory.mktemp("network") / "double.onnx", 2)


@pytest.fixture
def pictures(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    random = np.random.default_rng(0)
    for name, shape in (("a", (64, 79, 3)), ("b", (66, 64)), ("small", (31, 60, 3))):
        Image.fromarray(random.integers(0, 256, shape, np.uint8)).save(folder / f"{name}.png")
    return folder


@pytest.fixture
def labelled(pictures, network, tmp_path):
    out = tmp_path / "out"
    assert labels.label_pictures(pictures, network, out, threads=1) == 2
    return out


def test_pairs_are_written_and_read(pictures, labelled):
    assert {path.name for path in labelled.iterdir()} == {"a_LR.png", "a_HR.png", "b_LR.png", "b_HR.png"}
    pairs = labels.read_labelled(labelled)
    with Image.open(pictures / "a.png") as picture:
        np.testing.assert_array_equal(pairs[0][0], downscale_picture("bicubic", np.array(picture), 2).low)
    for low, high in pairs:
        np.testing.assert_array_equal(high, low.repeat(2, axis=0).repeat(2, axis=1))


def test_pictures_at_smaller_scales_are_labelled_too(pictures, network, tmp_path):
    out = tmp_path / "out"
    assert labels.label_pictures(pictures, network, out, scales=(1.0, 0.5), threads=2) == 4
    assert labels.label_pictures(pictures, network, out, scales=(1.0, 0.5, 0.75), threads=2) == 2
    sizes = {path.stem: read_rgb(path).shape[:2] for path in out.glob("*_LR.png")}
    wanted = {"a_LR": (32, 39), "a-75_LR": (24, 29), "a-50_LR": (16, 20)}
    assert sizes == sizes | wanted
    assert len(sizes) == 6
    reduced = Image.fromarray(read_rgb(pictures / "a.png")).resize((40, 32), Image.Resampling.LANCZOS)
    expected = downscale_picture("bicubic", np.asarray(reduced), 2).low
    np.testing.assert_array_equal(read_rgb(out / "a-50_LR.png"), expected)


def test_pictures_of_12_bits_fill_the_range(network, tmp_path):
    full = np.random.default_rng(0).integers(0, 256, (64, 64), np.uint8)
    (tmp_path / "dark").mkdir()
    Image.fromarray(full.astype(np.uint16) * 16).save(tmp_path / "dark" / "a.png")
    assert labels.label_pictures(tmp_path / "dark", network, tmp_path / "out", threads=1) == 1
    ((low, _),) = labels.read_labelled(tmp_path / "out")
    expected = downscale_picture("bicubic", full[..., np.newaxis].repeat(3, axis=2), 2).low
    assert np.abs(low.astype(int) - expected).max() <= 2


def test_pairs_that_are_there_are_kept(pictures, network, labelled):
    """A stopped run continues; LR without a label is made again."""
    (labelled / "b_HR.png").unlink()
    before = (labelled / "a_HR.png").stat().st_mtime_ns
    assert labels.label_pictures(pictures, network, labelled, threads=1) == 1
    assert (labelled / "a_HR.png").stat().st_mtime_ns == before
    assert len(labels.read_labelled(labelled)) == 2


def test_a_network_of_another_scale_is_refused(pictures, tmp_path):
    three = write_network(tmp_path / "three.onnx", 3)
    with pytest.raises(ValueError, match=r"three.onnx: makes \(1, 3, 96, .*; name a network that upscales by 2"):
        labels.label_pictures(pictures, three, tmp_path / "out", threads=1)
    assert not list((tmp_path / "out").glob("*"))


def test_folders_without_whole_pairs_are_refused(pictures, labelled, tmp_path):
    with pytest.raises(ValueError, match=r"no pair of \*_LR.png and \*_HR.png in it; make some"):
        labels.read_labelled(pictures)
    with pytest.raises(ValueError, match="no such folder"):
        labels.read_labelled(tmp_path / "gone")
    Image.new("RGB", (50, 41)).save(labelled / "a_HR.png")
    with pytest.raises(ValueError, match=r"a_HR.png: \(41, 50, 3\) for LR of \(32, .*; make the pair again") as caught:
        labels.read_labelled(labelled)
    assert "\n" not in str(caught.value)


def test_the_command_line(pictures, network, tmp_path, capsys):
    out = str(tmp_path / "out")
    labels.main([str(pictures), "--network", str(network), "-o", out, "--threads", "1"])
    assert capsys.readouterr().out == f"{out}: 2 pairs written\n"
    with pytest.raises(SystemExit) as caught:
        labels.main([str(tmp_path / "gone"), "--network", str(network), "-o", out])
    assert "gone: no such folder" in str(caught.value)
    with pytest.raises(SystemExit):
        labels.main([str(pictures), "--network", "gone.onnx", "-o", out])
    assert "gone.onnx: no such file; name an ONNX network" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        labels.main([str(pictures), "--network", str(network), "-o", out, "--scales", "1", "2"])
    assert "--scales: give numbers above 0, up to 1" in capsys.readouterr().err


def test_labelled_crops(pictures, labelled):
    """LR of the true picture, and the label as its truth, cut and flipped alike."""
    given = {"crop": 24, "scale": 2, "batch": 8, "seed": 0}
    crops = Crops(pictures, **given, degradations={"labelled": 3, "bicubic": 1}, labelled=labelled)
    assert [len(group) for group in crops.groups] == [2, 3]
    assert crops.shares.tolist() == [0.75, 0.25]
    only = Crops(pictures, **given, degradations={"labelled": 1}, labelled=labelled)
    for step in range(3):
        low, high = only.make_batch(step)
        assert (high == low.repeat_interleave(2, 2).repeat_interleave(2, 3)).all()
        assert low.std() > 0.05
    with pytest.raises(ValueError, match="no 'labelled' here"):
        Crops(pictures, **given, degradations={"labelled": 1})
    with pytest.raises(ValueError, match="no pair of"):
        Crops(pictures, **given, degradations={"labelled": 1}, labelled=pictures)


def test_pictures_whose_pairs_would_have_one_name_are_refused(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("one.png", "one.jpg"):
        Image.fromarray(np.zeros((40, 40, 3), np.uint8)).save(folder / name)
    with pytest.raises(ValueError, match=r"two pictures are named one; .*rename one"):
        labels.label_pictures(folder, tmp_path / "network.onnx", tmp_path / "out")
