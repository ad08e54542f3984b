import math

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from torch.nn import functional

from ciir.training.losses.adversarial import Adversary, SaturationWatch, find_losses
from ciir.training.networks.discriminator import Discriminator

UNDECIDED = torch.tensor([0.5, -0.5])


def adversary(name="bce", **options):
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(0)
        return Adversary(name, Discriminator((8, 16), normalise=False), **options)


def pictures(seed, count=4):
    """Noise and blurred noise, which are easy to separate."""
    real = torch.rand(count, 3, 16, 16, generator=torch.Generator().manual_seed(seed))
    return functional.avg_pool2d(real, 3, stride=1, padding=1), real


def teach(player, updates, rate=1e-3):
    return [player.update(*pictures(seed), rate) for seed in range(updates)]


def test_bce_is_the_cross_entropy_of_the_logits():
    bce, real, made = find_losses("bce"), torch.tensor([3.0, -1.0]), torch.tensor([0.5, -2.0])
    entropy = functional.binary_cross_entropy_with_logits
    want = 0.5 * (entropy(real, torch.ones(2)) + entropy(made, torch.zeros(2)))
    assert bce.discriminator(real, made).item() == pytest.approx(want.item())
    assert bce.generator(made).item() == pytest.approx(entropy(made, torch.ones(2)).item())
    assert bce.discriminator(torch.zeros(2), torch.zeros(2)).item() == pytest.approx(math.log(2))


def test_hinge():
    hinge, real, made = find_losses("hinge"), torch.tensor([2.0, 0.5]), torch.tensor([-3.0, 0.0])
    assert hinge.discriminator(real, made).item() == 0.5 * (0.25 + 0.5)
    assert hinge.generator(made).item() == 1.5


@pytest.mark.parametrize("name", ["bce", "hinge"])
def test_updates_separate_real_from_made(name):
    player = adversary(name)
    first, *_, last = teach(player, 60)
    assert last["discriminator_loss"] < 0.5 * first["discriminator_loss"]
    assert last["discriminator_accuracy"] == 1
    assert player.watch.updates == 60


def test_the_two_updates_are_independent():
    player = adversary()
    made, real = pictures(0)
    made.requires_grad_()
    player.update(made, real, 1e-3)
    assert made.grad is None
    player.optimiser.zero_grad()
    loss, features = player.judge(made)
    loss.backward()
    assert made.grad.abs().max() > 0
    assert len(features) == 4
    assert all(weight.grad is None and weight.requires_grad for weight in player.network.parameters())


def test_a_loss_that_is_not_a_number_stops_it_before_the_step():
    player = adversary()
    made, real = pictures(0)
    before = [weight.clone() for weight in player.network.parameters()]
    with pytest.raises(FloatingPointError, match="discriminator's loss is nan; lower learning_rate"):
        player.update(made * math.nan, real, 1e-3)
    assert all(torch.equal(a, b) for a, b in zip(before, player.network.parameters(), strict=True))


def test_a_discriminator_that_separates_everything_stops_the_run():
    watch = SaturationWatch(start=5, patience=10)
    for _ in range(5):
        watch.record(0.0, UNDECIDED + 30, UNDECIDED - 30)  # not counted yet
    for _ in range(9):
        watch.record(0.15, UNDECIDED + 4, UNDECIDED - 4)
    with pytest.raises(
        ValueError, match=r"separated all real .* since update 6 \(loss below 0.16, 10 times .*; lower"
    ) as e:
        watch.record(0.0, UNDECIDED + 30, UNDECIDED - 30)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("logit", [0.0, 25.0, -25.0])
def test_a_discriminator_with_equal_outputs_stops_the_run(logit):
    """Score_D = Score_G = 1.0 of the public logs is the logit 25; 0 is one whose last layer is dead."""
    watch = SaturationWatch(start=5, patience=10)
    alike = torch.full((2,), logit)
    for _ in range(14):
        watch.record(0.7, alike, alike)
    with pytest.raises(
        ValueError, match=r"all pictures the same value, real or made, since update 6 .*; lower learning_rate"
    ):
        watch.record(0.7, alike, alike)


def test_one_undecided_batch_resets_the_count():
    watch = SaturationWatch(start=0, patience=10)
    for step in range(100):
        if step % 10 == 9:
            watch.record(0.173, UNDECIDED + 4, UNDECIDED - 4)  # log(2) / 4: one of 4 pictures is undecided
        else:
            watch.record(0.0, UNDECIDED + 30, UNDECIDED - 30)
    assert watch.updates == 100
