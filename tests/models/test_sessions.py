import dataclasses
import os
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ciir.errors import BadCard, InvalidImage, UnsuitedProcessor
from ciir.models import cards, sessions
from ciir.models.catalogue import SHIPPED, list_entries, load_upscaler
from ciir.models.sessions import OnnxNetwork
from ciir.models.single import network
from ciir.models.single.network import SingleImageNetwork


def noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(11).random(shape, dtype=np.float32)


@pytest.fixture(scope="module")
def paper():
    return load_upscaler("paper")


@pytest.mark.parametrize("shape", [(1, 3, 1, 1), (2, 3, 1, 7), (1, 3, 13, 2), (3, 3, 25, 25), (0, 3, 5, 6)])
def test_any_size(paper, shape):
    got = paper(noise(*shape))
    assert got.shape == (shape[0], 3, 2 * shape[2], 2 * shape[3])
    assert got.dtype == np.float32
    assert ((got >= 0) & (got <= 1)).all()


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (3, 3), (4, 60), (7, 5)])
def test_the_smallest_pictures_are_as_flat_as_larger_ones(paper, size):
    for grey in (0.25, 0.5, 1.0):
        large = paper(np.full((1, 3, 24, 24), grey, np.float32))
        small = paper(np.full((1, 3, *size), grey, np.float32))
        assert np.abs(small - grey).max() <= np.abs(large - grey).max() + 1 / 255


def test_a_batch_equals_its_pictures_one_by_one(paper):
    images = noise(9, 3, 31, 40)
    np.testing.assert_allclose(paper(images), np.concatenate([paper(image[None]) for image in images]), atol=1e-5)


@pytest.mark.parametrize("size", [(40, 57), (97, 33), (34, 34), (20, 120)])
def test_tiled_equals_whole(paper, size, monkeypatch):
    images = noise(2, 3, *size)
    whole = paper(images)
    monkeypatch.setattr(network, "WINDOW", 34 * 34)  # tiles of 4 pixels within a halo of 15
    np.testing.assert_allclose(paper(images), whole, atol=1e-5)


def test_a_broken_halo_shows(paper, monkeypatch):
    images = noise(1, 3, 60, 60)
    whole = paper(images)
    monkeypatch.setattr(network, "WINDOW", 34 * 34)
    monkeypatch.setattr(paper, "radius", 5)
    assert np.abs(paper(images) - whole).max() > 1e-3


def test_not_a_number_is_refused(paper):
    images = noise(2, 3, 4, 4)
    images[1, 0, 2, 3] = np.nan
    with pytest.raises(InvalidImage, match=r"\(1, 0, 2, 3\)"):
        paper(images)


def test_calls_from_many_threads(paper):
    pictures = [noise(1, 3, 20 + i, 30 - i) for i in range(8)]
    want = [paper(picture) for picture in pictures]
    with ThreadPoolExecutor(8) as pool:
        got = list(pool.map(paper, pictures * 4))
    for i, output in enumerate(got):
        np.testing.assert_allclose(output, want[i % 8], atol=1e-6)


@pytest.mark.parametrize(
    "name", [entry.name for entry in list_entries() if entry.card and not entry.unsupported_reason]
)
def test_the_outputs_do_not_depend_on_the_cores(name):
    """So that a view is the same whether it is made alone, by all cores, or among many, each by one."""
    network = OnnxNetwork(SHIPPED / f"{name}.json", threads=3)
    given = {
        tensor.name: noise(*({"batch": 2, "height": 45, "width": 38}.get(size, size) for size in tensor.shape))
        for tensor in (network.card.input, *network.card.further)
    }
    for one, all_cores in zip(network.run(given, cores=1), network.run(given), strict=True):
        np.testing.assert_array_equal(one, all_cores)


def test_the_callers_floating_point_stays_as_it_was():
    """onnxruntime's option against denormals would leave this thread, and its children, flushing them to zero."""

    def keeps_denormals() -> bool:
        return bool(np.array([1e-40], np.float32)[0] * np.float32(1) > 0)

    found = []
    SingleImageNetwork(SHIPPED / "paper.json", threads=1)(noise(1, 3, 4, 4))
    child = threading.Thread(target=lambda: found.append(keeps_denormals()))
    child.start()
    child.join()
    assert keeps_denormals()
    assert found == [True]


def test_a_network_that_is_missing(tmp_path):
    shutil.copy(SHIPPED / "paper.json", tmp_path)
    with pytest.raises(BadCard, match=r"paper\.onnx: can't be read"):
        SingleImageNetwork(tmp_path / "paper.json")


def test_a_network_that_is_not_its_cards(tmp_path):
    shutil.copy(SHIPPED / "paper.json", tmp_path)
    (tmp_path / "paper.onnx").write_bytes((SHIPPED / "paper.onnx").read_bytes()[:-1])
    with pytest.raises(BadCard, match="is not its card's"):
        SingleImageNetwork(tmp_path / "paper.json")


@pytest.mark.parametrize(("twin", "remedy"), [("paper", "use paper, its float twin"), ("", "use a float network")])
def test_int8_on_a_processor_that_gets_it_wrong_is_refused(tmp_path, monkeypatch, twin, remedy):
    path = tmp_path / "paper.json"
    card = dataclasses.replace(cards.read_card(SHIPPED / "paper.json"), precision="int8", float_twin=twin)
    cards.write_card(card, path)
    shutil.copy(SHIPPED / "paper.onnx", tmp_path)
    monkeypatch.setattr(sessions.processor, "int8_unsupported_reason", lambda: "this processor has no VNNI")
    with pytest.raises(
        UnsuitedProcessor, match=f"paper: it computes in int8, and this processor has no VNNI; {remedy}"
    ):
        SingleImageNetwork(path)
    monkeypatch.setattr(sessions.processor, "int8_unsupported_reason", lambda: "")
    assert SingleImageNetwork(path).name == "paper"


@pytest.mark.parametrize("sizes", [cards.Sizes(16, 6), cards.Sizes(1, 4, square=True), cards.Sizes(40)])
def test_the_network_meets_only_sizes_that_it_takes(paper, sizes, monkeypatch):
    seen = []

    def run(images):
        seen.append(images.shape[2:])
        return SingleImageNetwork._run(paper, images)

    monkeypatch.setattr(network, "WINDOW", 48 * 48)
    monkeypatch.setattr(paper, "card", dataclasses.replace(paper.card, sizes=sizes))
    monkeypatch.setattr(paper, "_run", run)
    for shape in [(1, 3, 3, 5), (2, 3, 20, 33), (1, 3, 61, 130)]:
        got = paper(noise(*shape))
        assert got.shape == (shape[0], 3, 2 * shape[2], 2 * shape[3])
    assert seen
    assert all(size == sizes.fitted(*size) for size in seen)


def test_no_denormals_reach_the_network(monkeypatch):
    """Its workers flush them to zero and the calling thread does not: two runs would differ in which did what."""
    network = load_upscaler("fast")
    seen = []

    class Session:
        def run(self, names, feeds):
            (images,) = feeds.values()
            seen.append(images)
            return [images.repeat(2, axis=2).repeat(2, axis=3)]

    monkeypatch.setattr(network, "_session", lambda cores: Session())
    images = np.full((1, 3, 8, 8), 1e-40, np.float32)
    images[0, 0, 0, :3] = 0.5, 1 / 65535**2, sessions.FAINTEST
    network(images)
    assert seen[0][0, 0, 0, :3].tolist() == images[0, 0, 0, :3].tolist()
    assert np.count_nonzero(seen[0]) == 3
    assert images[0, 1, 0, 0] > 0  # the caller's own array stays as it is


def test_nothing_is_told_to_anyone(tmp_path):
    """onnxruntime's Linux wheels keep what sessions do in the user's cache folder, and send it, unless told not to."""
    program = "from ciir.models import catalogue; catalogue.load_upscaler('paper')"
    alone = {"HOME": str(tmp_path), "PATH": os.defpath, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", program], check=True, env=alone, cwd=tmp_path)  # noqa: S603 - our own
    assert list(tmp_path.rglob("*")) == []
