"""What the benchmark of speed compares is the same work, and it says where a bound does not hold."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs the training extra")

from ciir.benchmarks import speed
from ciir.models import catalogue


def test_multiply_adds_are_the_cards():
    card = catalogue.load_upscaler("paper").card
    assert speed.multiply_adds(card, 360, 640) == pytest.approx(146.4e9, rel=1e-3)  # README's, for 1280x720


@pytest.mark.parametrize("int8", [False, True])
def test_the_peak_is_that_of_a_real_product(int8):
    (made,) = speed.product(int8=int8, side=16)()
    random = np.random.default_rng(0)
    left, right = random.integers(0, 256, (16, 16)), random.integers(-127, 128, (16, 16))
    np.testing.assert_allclose(made, left @ right, rtol=1e-6)


def test_a_bound_that_does_not_hold_is_told(monkeypatch, capsys):
    monkeypatch.setattr(speed, "int8", lambda rounds: iter([f"{rounds} rounds", ("1 at most 2", True)]))
    assert speed.main(["--only", "int8", "--rounds", "3"]) == 0
    assert capsys.readouterr().out == "3 rounds\n1 at most 2: holds\n"
    monkeypatch.setattr(speed, "int8", lambda _: iter([("3 at most 2", False), ("1 at most 2", True)]))
    assert speed.main(["--only", "int8"]) == 1
    assert "3 at most 2: DOES NOT HOLD\n" in capsys.readouterr().out
