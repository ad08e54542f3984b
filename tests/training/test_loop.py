import csv
from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from training import loop
from training.data import Crops


def load(path):
    return torch.load(path, weights_only=True)


@pytest.fixture(scope="module")
def unbroken(recipe, tmp_path_factory):
    return loop.train(replace(recipe, steps=5), tmp_path_factory.mktemp("unbroken"))


def test_a_run_leaves_a_checkpoint_and_a_log(unbroken):
    assert load(unbroken)["step"] == 5
    with (unbroken.parent / "log.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["step"]) for row in rows] == [2, 4, 5]
    assert all(0 < float(row["loss"]) < 2 for row in rows)
    assert not list(unbroken.parent.glob("*.partial"))


def test_a_resumed_run_equals_an_unbroken_one_bit_for_bit(recipe, unbroken, tmp_path, monkeypatch):
    draw = Crops.at

    def stop_at_3(self, step):
        if step == 3:
            raise KeyboardInterrupt
        return draw(self, step)

    recipe = replace(recipe, steps=5)
    with monkeypatch.context() as patch:
        patch.setattr(Crops, "at", stop_at_3)
        with pytest.raises(KeyboardInterrupt):
            loop.train(recipe, tmp_path)
    assert load(tmp_path / "checkpoint.pt")["step"] == 2
    resumed, want = load(loop.train(recipe, tmp_path)), load(unbroken)
    assert resumed["psnr"] == want["psnr"]
    for key, weight in want["network"].items():
        assert torch.equal(resumed["network"][key], weight), key
    for index, moments in want["optimiser"]["state"].items():
        for key, value in moments.items():
            assert torch.equal(resumed["optimiser"]["state"][index][key], value), (index, key)


def test_training_lowers_the_loss(recipe, tmp_path):
    path = loop.train(replace(recipe, steps=60, validate_every=20), tmp_path)
    with (path.parent / "log.csv").open(newline="") as file:
        losses = [float(row["loss"]) for row in csv.DictReader(file)]
    assert losses[-1] < 0.7 * losses[0]


def test_a_loss_that_is_not_a_number_stops_the_run(recipe, tmp_path, monkeypatch):
    nan = torch.full((2, 3, 12, 12), torch.nan), torch.zeros(2, 3, 24, 24)
    monkeypatch.setattr(Crops, "at", lambda self, step: nan)
    with pytest.raises(FloatingPointError, match=r"step 0.*lower learning_rate"):
        loop.train(recipe, tmp_path)
    assert not (tmp_path / "checkpoint.pt").exists()


def test_another_recipes_checkpoint_is_not_continued(recipe, unbroken):
    with pytest.raises(ValueError, match="made by another recipe"):
        loop.train(replace(recipe, steps=5, seed=2), unbroken.parent)


def test_learning_rate(recipe):
    recipe = replace(recipe, steps=100, warmup=10, learning_rate=1.0)
    rates = [loop.learning_rate(recipe, step) for step in range(101)]
    assert rates[0] == pytest.approx(0.1)
    assert rates[10] == max(rates) == 1.0
    assert rates[55] == pytest.approx(0.5)
    assert rates[100] == pytest.approx(0.0)


def test_a_validation_folder_without_pairs(recipe, tmp_path):
    with pytest.raises(ValueError, match=r"no \*_LR\.png"):
        loop.validate(torch.nn.Identity(), tmp_path, 2)
