from dataclasses import replace

import pytest

torch = pytest.importorskip("torch", reason="needs the training extra")

from ciir.training.loop import checkpoints
from ciir.training.loop import run as trainer
from ciir.training.loop.run import Run

GAN = {"adversarial": "hinge"}


@pytest.fixture
def saved(recipe, tmp_path):
    """A checkpoint of `recipe` after no step."""
    Run(recipe).save(tmp_path / "checkpoint.pt")
    return tmp_path / "checkpoint.pt"


def change(path, **fields):
    state = checkpoints.read_checkpoint(path) | fields
    torch.save({key: value for key, value in state.items() if value is not None}, path)


def test_learning_rate(recipe):
    recipe = replace(recipe, steps=100, warmup=10, learning_rate=1.0)
    rates = [trainer.learning_rate(recipe, step) for step in range(101)]
    assert rates[0] == pytest.approx(0.1)
    assert rates[10] == max(rates) == 1.0
    assert rates[55] == pytest.approx(0.5)
    assert rates[100] == pytest.approx(0.0)


def test_the_learning_rate_falls_by_the_clock(recipe):
    """By the steps where these are further, and after the warm-up, which is of steps."""
    recipe = replace(recipe, steps=100, minutes=2.0, warmup=10, learning_rate=1.0)
    assert trainer.learning_rate(recipe, 4, 100.0) == pytest.approx(0.5)
    assert trainer.learning_rate(recipe, 10, 0.0) == 1.0
    assert trainer.learning_rate(recipe, 20, 60.0) == pytest.approx(0.5)
    assert trainer.learning_rate(recipe, 55, 30.0) == pytest.approx(0.5)
    assert trainer.learning_rate(recipe, 20, 120.0) == trainer.learning_rate(recipe, 20, 130.0) == pytest.approx(0.0)


def test_the_end_of_a_run(recipe):
    run = Run(replace(recipe, steps=5, minutes=2.0))
    assert not run.is_done
    run.seconds = 119.0
    assert not run.is_done
    run.seconds = 120.0
    assert run.is_done
    run.step, run.seconds = 5, 0.0
    assert run.is_done
    forever = Run(replace(recipe, steps=5))
    forever.seconds = 1e9
    assert not forever.is_done


def test_an_update_takes_the_rate_of_its_time(recipe):
    run = Run(replace(recipe, steps=100, warmup=0, minutes=1.0, learning_rate=1.0))
    run.seconds = 30.0
    run.update(torch.rand(2, 3, 12, 12), torch.rand(2, 3, 24, 24))
    assert run.optimiser.param_groups[0]["lr"] == pytest.approx(0.5)


def test_the_running_mean(recipe):
    network, average = torch.nn.BatchNorm1d(2), torch.nn.BatchNorm1d(2)
    with torch.no_grad():
        network.weight.fill_(3.0)
        network.running_mean.fill_(7.0)
    trainer.update_average(average, network, 0.75)
    assert average.weight.tolist() == [1.5, 1.5]  # 0.75 * 1 + 0.25 * 3
    assert average.running_mean.tolist() == [7.0, 7.0]
    trainer.update_average(average, network, 0.0)
    assert torch.equal(average.weight, network.weight)


@pytest.mark.parametrize("clip", [0.0, 0.5])
def test_a_gradient_too_long_for_float32_stops_the_run_before_a_weight_moves(recipe, clip):
    made = Run(replace(recipe, loss="mse", clip=clip))
    before = [weight.clone() for weight in made.trained]
    # The loss is some 1e32, which float32 holds; the square of its gradient's norm is not.
    with pytest.raises(FloatingPointError, match="step 0: the gradient's norm is inf; lower learning_rate"):
        made.update(1e12 * torch.rand(2, 3, 12, 12), torch.full((2, 3, 24, 24), 1e16))
    assert all(torch.equal(one, other) for one, other in zip(made.trained, before, strict=True))


@pytest.mark.parametrize("fields", [{"seed": 2}, {"steps": 9}, {"train": "t"}, {"clip": 0.0}, GAN])
def test_another_recipes_checkpoint_is_not_continued(recipe, saved, fields):
    with pytest.raises(ValueError, match=rf"another recipe: {next(iter(fields))} is .* there and .* here") as caught:
        Run(replace(recipe, **fields)).resume(saved)
    assert "\n" not in str(caught.value)


def test_what_a_run_may_change(recipe, saved):
    Run(replace(recipe, validate="elsewhere", validate_every=7, device="cpu", vgg="v", initial="i")).resume(saved)


@pytest.mark.parametrize("missing", ["raw", "objective"])
def test_a_checkpoint_too_old_to_continue_still_gives_its_weights(recipe, tmp_path, missing):
    recipe, path = replace(recipe, **GAN), tmp_path / "c.pt"
    first = Run(recipe)
    first.save(path)
    change(path, **{missing: None})
    with pytest.raises(ValueError, match=r"older version.*as `initial`"):
        Run(recipe).resume(path)
    second = Run(replace(recipe, seed=5))
    second.start_from(path)
    for name, weight in first.network.state_dict().items():
        assert torch.equal(second.network.state_dict()[name], weight)
        assert torch.equal(second.average.state_dict()[name], weight)


def test_initial_of_another_network(recipe, saved):
    with pytest.raises(
        ValueError, match=r"holds lite with \{'blocks': 1.*not this recipe's lite with \{'blocks': 2"
    ) as e:
        Run(replace(recipe, options={"blocks": 2, "channels": 8})).start_from(saved)
    assert "\n" not in str(e.value)


def test_cuda_where_there_is_none(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert trainer.choose_device("auto") == trainer.choose_device("cpu") == torch.device("cpu")
    with pytest.raises(ValueError, match=r"cuda, but torch .* finds no GPU; give cpu"):
        trainer.choose_device("cuda")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_gpu_trains_as_the_cpu_does(recipe):
    """The weights after a few steps; float32 on both, whose sums differ in order."""
    torch.manual_seed(0)
    batch = torch.rand(2, 3, 12, 12), torch.rand(2, 3, 24, 24)
    runs = [Run(replace(recipe, device=name)) for name in ("cpu", "cuda")]
    for _ in range(3):
        for each in runs:
            each.update(*batch)
    for one, other in zip(*(each.network.parameters() for each in runs), strict=True):
        torch.testing.assert_close(one, other.cpu(), atol=1e-3, rtol=0)  # Adam's steps are 1e-3 each
