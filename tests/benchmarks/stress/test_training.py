"""The cases hold on a few updates; and each breaks where what it watches is broken."""

from dataclasses import replace

import pytest

from ciir.benchmarks.stress import training
from ciir.benchmarks.stress.case import Effort, Found, Skipped

torch = pytest.importorskip("torch", reason="needs the training extra")

QUICK = Effort(models=(), quick=True)


def broken(case):
    return [found.what for found in case(QUICK) if isinstance(found, Found) and not found.holds]


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(training, "QUICK_UPDATES", 2)


@pytest.mark.parametrize("case", training.CASES, ids=lambda case: case.__name__)
def test_it_holds(case):
    assert broken(case) == []


def test_without_torch_it_is_skipped(monkeypatch):
    monkeypatch.setattr("ciir.benchmarks.stress.case.find_spec", lambda name: None)
    for case in training.CASES:
        (only,) = case(QUICK)
        assert isinstance(only, Skipped)
        assert only.why == "needs torch: pip install '.[training]' in the folder of ciir's source code"


def test_an_explosion_is_noticed_with_its_message(monkeypatch):
    exact = training._recipe
    monkeypatch.setattr(
        training, "_recipe", lambda *given, **named: replace(exact(*given, **named), learning_rate=1e30)
    )
    found = [one for one in training.stays_finite(QUICK) if isinstance(one, Found)]
    assert not any(one.holds for one in found)
    assert all("lower learning_rate" in one.where for one in found)


def test_a_coarser_number_than_bfloat16_is_noticed(monkeypatch):
    from ciir.training.loop.run import Run

    update = Run.update

    def coarse(self, low, high):
        if self.recipe.bfloat16:
            for weight in self.network.parameters():
                weight.data.mul_(1 + 0.2 * torch.rand_like(weight))
        return update(self, low, high)

    monkeypatch.setattr(Run, "update", coarse)
    assert any("gradient" in what for what in broken(training.bfloat16))


def test_a_guard_that_looks_away_is_noticed(monkeypatch):
    monkeypatch.setattr("ciir.training.loop.run.Run.checks_loss", False)
    assert "NaN in a picture, let through" in broken(training.guards)


def test_a_checkpoint_that_takes_anything_is_noticed(monkeypatch):
    monkeypatch.setattr("ciir.training.loop.checkpoints._is_finite", lambda value: True)
    assert broken(training.guards) == ["NaN in a checkpoint's weight, saved"]
