import dataclasses
import os
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest

from ciir.errors import BadCard, UnsuitedProcessor
from ciir.models import cards, sessions
from ciir.models.catalogue import SHIPPED, list_entries
from ciir.models.sessions import OnnxNetwork

SUPPORTED = [entry.name for entry in list_entries() if entry.card and not entry.unsupported_reason]


def make_noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(11).random(shape, dtype=np.float32)


@pytest.mark.parametrize("name", SUPPORTED)
def test_outputs_do_not_depend_on_the_number_of_cores(name):
    """So a view is the same whether it is upscaled on all cores, or among many, each on one."""
    network = OnnxNetwork(SHIPPED / f"{name}.json", threads=3)
    inputs = {
        tensor.name: make_noise(
            *({"batch": 2, "height": 45, "width": 38, "taps": 7}.get(size, size) for size in tensor.shape)
        )
        for tensor in (network.card.input, *network.card.extra_inputs)
    }
    for one, all_cores in zip(network.run(inputs, cores=1), network.run(inputs), strict=True):
        np.testing.assert_array_equal(one, all_cores)


def test_the_callers_threads_keep_denormals():
    """onnxruntime's option against denormals would make this thread, and its children, flush them to zero."""

    def keeps_denormals() -> bool:
        return bool(np.array([1e-40], np.float32)[0] * np.float32(1) > 0)

    found = []
    OnnxNetwork(SHIPPED / "paper.json", threads=1).run({"image": make_noise(1, 3, 8, 8)})
    child = threading.Thread(target=lambda: found.append(keeps_denormals()))
    child.start()
    child.join()
    assert keeps_denormals()
    assert found == [True]


def test_a_missing_network_is_refused(tmp_path):
    shutil.copy(SHIPPED / "paper.json", tmp_path)
    with pytest.raises(BadCard, match=r"paper\.onnx: can't be read"):
        OnnxNetwork(tmp_path / "paper.json")


def test_a_network_other_than_the_cards_is_refused(tmp_path):
    shutil.copy(SHIPPED / "paper.json", tmp_path)
    (tmp_path / "paper.onnx").write_bytes((SHIPPED / "paper.onnx").read_bytes()[:-1])
    with pytest.raises(BadCard, match="is not its card's"):
        OnnxNetwork(tmp_path / "paper.json")


@pytest.mark.parametrize(("twin", "remedy"), [("paper", "use paper, its float twin"), ("", "use a float network")])
def test_int8_on_a_processor_without_support_is_refused(tmp_path, monkeypatch, twin, remedy):
    path = tmp_path / "paper.json"
    card = dataclasses.replace(cards.read_card(SHIPPED / "paper.json"), precision="int8", float_twin=twin)
    cards.write_card(card, path)
    shutil.copy(SHIPPED / "paper.onnx", tmp_path)
    monkeypatch.setattr(sessions.processor, "int8_unsupported_reason", lambda: "this processor has no VNNI")
    message = f"paper: it computes in int8, but this processor has no VNNI; {remedy}"
    with pytest.raises(UnsuitedProcessor, match=message):
        OnnxNetwork(path)
    monkeypatch.setattr(sessions.processor, "int8_unsupported_reason", lambda: "")
    assert OnnxNetwork(path).name == "paper"


def test_no_denormals_reach_the_network(monkeypatch):
    """Its threads flush them to zero and the calling thread does not: runs would differ in which computed what."""
    network = OnnxNetwork(SHIPPED / "fast.json")
    given = []

    class Session:
        def run(self, names, inputs):
            given.extend(inputs.values())
            return []

    monkeypatch.setattr(network, "_get_session", lambda cores: Session())
    images = np.full((1, 3, 8, 8), 1e-40, np.float32)
    images[0, 0, 0, :3] = 0.5, 1 / 65535**2, sessions.SMALLEST
    network.run({"image": images})
    assert given[0][0, 0, 0, :3].tolist() == images[0, 0, 0, :3].tolist()
    assert np.count_nonzero(given[0]) == 3
    assert images[0, 1, 0, 0] > 0  # the caller's array is not changed


def test_onnxruntime_reports_nothing_and_keeps_no_file(tmp_path):
    """By default its Linux wheels record sessions in the user's cache folder, and send them."""
    program = "from ciir.models.catalogue import load_upscaler; load_upscaler('paper')"
    environment = {"HOME": str(tmp_path), "PATH": os.defpath, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", program], check=True, env=environment, cwd=tmp_path)  # noqa: S603 - our own
    assert list(tmp_path.rglob("*")) == []
