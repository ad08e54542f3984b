import csv
import signal
from dataclasses import fields, replace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the training extra")

from PIL import Image

from ciir.service.cli.main import main
from ciir.service.cli.parser import parse_arguments
from ciir.training.data.crops import Crops
from ciir.training.data.light_field.crops import LightFieldCrops
from ciir.training.data.light_field.textures import TEXTURE
from ciir.training.loop import logs, train
from ciir.training.loop.interrupt import Stopped
from ciir.training.recipe import OVERRIDES, Recipe

STEPS = 5
SMALL_FIELD = {"network": "light_field", "options": {"widths": [8, 8], "width": 8, "depth": 1, "planes": 5}}
GAN = {"perceptual": "discriminator", "perceptual_weight": 0.1, "adversarial": "bce", "bfloat16": True, "ema": 0.9}


def load(path):
    return torch.load(path, weights_only=True)


def rows(folder):
    with (folder / "log.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def assert_same(got, want, at=""):
    """Tensors in nested dicts and lists, bit for bit."""
    if isinstance(want, torch.Tensor):
        assert torch.equal(got, want), at
    elif isinstance(want, dict):
        assert got.keys() == want.keys(), at
        for key, value in want.items():
            assert_same(got[key], value, f"{at}/{key}")
    elif isinstance(want, (list, tuple)):
        for index, (one, other) in enumerate(zip(got, want, strict=True)):
            assert_same(one, other, f"{at}/{index}")
    else:
        assert got == want, at


def at_step(monkeypatch, step, act):
    """`act()` while the batch of `step` is drawn."""
    draw = Crops.make_batch

    def acting(self, wanted):
        if wanted == step:
            act()
        return draw(self, wanted)

    monkeypatch.setattr(Crops, "make_batch", acting)


@pytest.fixture(autouse=True)
def no_picture(monkeypatch):
    """Half a second each; `unbroken` draws real ones."""
    monkeypatch.setattr(logs, "draw_plot", lambda rows, losses, title: b"")


@pytest.fixture(scope="module", params=[{}, GAN], ids=["pixels", "gan"])
def unbroken(request, recipe, tmp_path_factory):
    recipe = replace(recipe, steps=STEPS, **request.param)
    return recipe, train.train(recipe, tmp_path_factory.mktemp("unbroken"))


def test_a_run_leaves_a_checkpoint_and_logs(unbroken):
    recipe, checkpoint = unbroken
    assert load(checkpoint)["step"] == STEPS
    log = rows(checkpoint.parent)
    assert [int(row["step"]) for row in log] == [2, 4, 5]
    for row in log:
        terms = [float(row[name]) for name in ("l1", "discriminator", "adversarial") if name in row]
        # The log has 7 digits.
        assert float(row["loss"]) == pytest.approx(sum(terms), rel=1e-5)
        assert 0 < float(row["l1"]) < 2
    assert ("discriminator_loss" in log[0]) == bool(recipe.adversarial)
    assert {path.name for path in checkpoint.parent.iterdir()} == {
        "checkpoint.pt",
        "plot.png",
        "log.csv",
        "tensorboard",
    }


def test_a_killed_run_continues_bit_for_bit(unbroken, tmp_path, monkeypatch):
    recipe, checkpoint = unbroken

    def kill():
        raise MemoryError

    with monkeypatch.context() as patch:
        at_step(patch, 3, kill)
        with pytest.raises(MemoryError):
            train.train(recipe, tmp_path)
    assert load(tmp_path / "checkpoint.pt")["step"] == 2
    train.train(recipe, tmp_path)
    got, want = load(tmp_path / "checkpoint.pt"), load(checkpoint)
    assert_same(got | {"seconds": 0}, want | {"seconds": 0})
    assert [row["psnr"] for row in rows(tmp_path)] == [row["psnr"] for row in rows(checkpoint.parent)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_step_and_the_run_goes_on_from_there(unbroken, tmp_path, monkeypatch, number):
    recipe, checkpoint = unbroken
    before = signal.getsignal(number)
    with monkeypatch.context() as patch:
        at_step(patch, 2, lambda: signal.raise_signal(number))
        with pytest.raises(Stopped, match=r"step 3 of 5.*continue with the same command") as caught:
            train.train(recipe, tmp_path)
    assert caught.value.number == number
    assert signal.getsignal(number) is before
    assert load(tmp_path / "checkpoint.pt")["step"] == 3
    train.train(recipe, tmp_path)
    assert_same(load(tmp_path / "checkpoint.pt") | {"seconds": 0}, load(checkpoint) | {"seconds": 0})


def test_a_killed_run_on_light_fields_continues_bit_for_bit(recipe, tmp_path, monkeypatch):
    """Across a block of scenes, which a thread prefetches."""
    random = np.random.default_rng(0)
    for folder, shape in (("train", (1, 1, TEXTURE, TEXTURE, 3)), ("views", (3, 3, 24, 24, 3))):
        (tmp_path / folder).mkdir()
        for place in np.ndindex(shape[:2]):
            picture = random.integers(0, 256, shape[2:], np.uint8)
            Image.fromarray(picture).save(tmp_path / folder / f"view_{place[0]}_{place[1]}.png")
    paths = {"train": str(tmp_path / "train"), "validate": str(tmp_path / "views")}
    recipe = replace(recipe, light_field=True, **SMALL_FIELD, **paths, steps=8, crop=16, validate_every=4, eased=8)
    wanted = load(train.train(recipe, tmp_path / "a"))
    draw = LightFieldCrops.make_batch

    def kill(self, step):
        if step == 5:
            raise MemoryError
        return draw(self, step)

    with monkeypatch.context() as patch:
        patch.setattr(LightFieldCrops, "make_batch", kill)
        with pytest.raises(MemoryError):
            train.train(recipe, tmp_path / "b")
    assert load(tmp_path / "b" / "checkpoint.pt")["step"] == 4
    found = load(train.train(recipe, tmp_path / "b"))
    assert_same(found | {"seconds": 0}, wanted | {"seconds": 0})


class Clock:
    """A second for each batch, and none for anything else."""

    def __init__(self, monkeypatch):
        self.now = 1000.0
        draw = Crops.make_batch

        def make_batch(crops, step):
            self.now += 1.0
            return draw(crops, step)

        monkeypatch.setattr(Crops, "make_batch", make_batch)
        monkeypatch.setattr(train.time, "monotonic", lambda: self.now)


def test_a_run_of_minutes_ends_by_the_clock(recipe, tmp_path, monkeypatch):
    """With a last validation and a step size near zero, though many steps are left."""
    Clock(monkeypatch)
    recipe = replace(recipe, steps=1000, minutes=0.1, warmup=0, validate_every=4)
    checkpoint = train.train(recipe, tmp_path)
    state = load(checkpoint)
    assert (state["step"], state["seconds"]) == (6, 6.0)
    log = rows(tmp_path)
    assert [int(row["step"]) for row in log] == [4, 6]
    rates = [0.5e-3 * (1 + np.cos(np.pi * seconds / 6)) for seconds in (4, 6)]
    assert [float(row["learning_rate"]) for row in log] == pytest.approx(rates, abs=1e-9)
    before = checkpoint.read_bytes()
    assert train.train(recipe, tmp_path) == checkpoint
    assert checkpoint.read_bytes() == before


def test_a_run_of_minutes_goes_on_with_the_time_that_is_left(recipe, tmp_path, monkeypatch):
    clock = Clock(monkeypatch)
    recipe = replace(recipe, steps=1000, minutes=0.1, warmup=0, validate_every=100)
    with monkeypatch.context() as patch:
        at_step(patch, 2, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(Stopped, match="step 3 of 1000"):
            train.train(recipe, tmp_path)
    assert load(tmp_path / "checkpoint.pt")["seconds"] == 3.0
    clock.now += 5000.0  # between the runs
    assert load(train.train(recipe, tmp_path))["step"] == 6
    assert [int(row["step"]) for row in rows(tmp_path)] == [6]


def test_a_gradient_that_is_not_a_number_replaces_no_checkpoint(recipe, tmp_path, monkeypatch):
    loss = torch.nn.functional.l1_loss

    def infinite_slope(output, high):
        return loss(output, high) + (0.0 * output.sum()).sqrt()  # its value is 0, its gradient is no number

    monkeypatch.setattr("ciir.training.losses.pixel.LOSSES", {"l1": loss})
    train.train(replace(recipe, steps=2), tmp_path / "a")
    good = (tmp_path / "a" / "checkpoint.pt").read_bytes()
    monkeypatch.setattr("ciir.training.losses.pixel.LOSSES", {"l1": infinite_slope})
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "checkpoint.pt").write_bytes(good)
    monkeypatch.setattr("ciir.training.recipe.find_difference", lambda saved, recipe: "")
    with pytest.raises(FloatingPointError, match="step 2: the gradient's norm is nan; lower learning_rate"):
        train.train(replace(recipe, steps=3), tmp_path / "b")
    assert (tmp_path / "b" / "checkpoint.pt").read_bytes() == good


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"validate": "gone"}, "gone: no such folder"),
        ({"train": "gone"}, "gone: no such folder"),
        ({"loss": "l3"}, "'l3'"),
        ({"network": "gpt"}, "'gpt'"),
        ({"options": {"block": 3}}, "options: lite has no 'block'; give blocks, channels, batch_norm$"),
        (
            {"options": {"blocks": "x"}},
            "lite can't be made with blocks = 'x'; give values like the default, blocks = 6",
        ),
        (SMALL_FIELD | {"options": {"planes": 1}}, "options: 1 planes and a depth of 3; give at least 2 planes"),
        ({"scale": 4}, "scale is 4, but lite is made for 2"),
        ({"light_field": True}, 'light_field is true, but lite takes single pictures; set network = "light_field", or'),
        (SMALL_FIELD, "light_field is false, but light_field takes a window of views; set light_field = true, or"),
        ({"initial": "gone.pt"}, r"gone\.pt"),
        ({"crop": 48}, "smaller"),
    ],
)
def test_a_wrong_recipe_writes_nothing(recipe, tmp_path, change, message):
    with pytest.raises(ValueError, match=message) as caught:
        train.train(replace(recipe, **change), tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "run").exists()


def test_a_file_where_the_folder_should_be(recipe, tmp_path):
    (tmp_path / "run").write_text("mine")
    with pytest.raises(ValueError, match="a file is there"):
        train.train(recipe, tmp_path / "run")


def test_the_command_line(recipe, tmp_path, capsys, monkeypatch):
    path = tmp_path / "tiny.toml"
    path.write_text(
        'name = "tiny"\nnetwork = "lite"\ntrain = "gone"\nvalidate = "gone"\nsteps = 9\noptions = { blocks = 1, '
        "channels = 8 }\ncrop = 24\nbatch = 2\nvalidate_every = 2\n"
    )
    argv = ["train", str(path), "-o", str(tmp_path / "run")]
    assert main(argv) == 2
    assert "gone: no such folder" in capsys.readouterr().err
    argv += ["--train", recipe.train, "--validate", recipe.validate, "--steps", "4", "--device", "cpu"]
    with monkeypatch.context() as patch:
        at_step(patch, 0, lambda: signal.raise_signal(signal.SIGINT))
        with pytest.raises(SystemExit) as caught:
            main(argv)
    assert caught.value.code == 130
    assert "ciir: stopped at step 1 of 4" in capsys.readouterr().err.splitlines()[-1]
    assert main([*argv, "--name", "mine"]) == 2
    assert "name is 'tiny' there and 'mine' here" in capsys.readouterr().err
    assert main(argv) == 0
    shown = capsys.readouterr()
    assert "done; next: ciir export" in shown.out
    lines = [line for line in shown.err.splitlines() if line.startswith("step ")]
    assert [line.partition(":")[0] for line in lines] == ["step 2 of 4", "step 4 of 4"]


def test_options_of_the_command_are_fields_of_the_recipe():
    args = parse_arguments(["train", "a.toml", "-o", "out"])
    assert set(OVERRIDES) == {field.name for field in fields(Recipe)} & set(vars(args))


def test_a_warm_up_longer_than_the_run_is_reported(recipe, tmp_path, capsys):
    train.report_start(replace(recipe, steps=5, warmup=5), 0)
    assert "warmup: 5 of 5 steps; the step size never reaches learning_rate" in capsys.readouterr().err
    train.report_start(replace(recipe, steps=5, warmup=4), 2)
    assert capsys.readouterr().err.splitlines() == [
        "training tiny: from step 2 to 5; stop with Ctrl-C, continue with the same command"
    ]


def test_a_loss_that_is_not_a_number_stops_the_run(recipe, tmp_path, monkeypatch):
    nan = torch.full((2, 3, 12, 12), torch.nan), torch.zeros(2, 3, 24, 24)
    monkeypatch.setattr(Crops, "make_batch", lambda self, step: nan)
    with pytest.raises(FloatingPointError, match=r"step 0.*lower learning_rate"):
        train.train(recipe, tmp_path)
    assert not (tmp_path / "checkpoint.pt").exists()
