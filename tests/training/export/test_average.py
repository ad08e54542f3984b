import pytest

torch = pytest.importorskip("torch", reason="needs the training extra")

from ciir.training.export import average
from ciir.training.loop import checkpoints
from ciir.training.networks.collapsible import CollapsibleConv


def checkpoint(path, value, network="compact"):
    weights = {"w": torch.full((2, 2), value), "count": torch.tensor(7)}
    recipe = {"network": network, "options": {}, "name": "x"}
    state = {
        "network": weights,
        "raw": weights,
        "optimiser": {},
        "step": 5,
        "recipe": recipe,
        "commit": "c",
        "seconds": 1.0,
    }
    checkpoints.save_checkpoint(path, state)
    return path


def test_weights_are_the_mean_and_the_recipe_says_so(tmp_path):
    paths = [checkpoint(tmp_path / f"{value}.pt", value) for value in (1.0, 2.0, 6.0)]
    average.average_checkpoints(paths, tmp_path / "mean" / "m.pt")
    state = checkpoints.read_checkpoint(tmp_path / "mean" / "m.pt")
    assert torch.equal(state["network"]["w"], torch.full((2, 2), 3.0))
    assert state["network"]["count"] == 7
    assert state["recipe"]["averaged"] == [path.as_posix() for path in paths]


def test_branches_are_averaged_as_the_kernel_that_they_make(tmp_path):
    """The mean of factors is not the mean of their products."""
    paths, kernels = [], []
    for seed in (1, 2):
        torch.manual_seed(seed)
        layer = CollapsibleConv(4, 4)
        torch.nn.init.normal_(layer.point)
        kernels.append(layer.weight())
        path = checkpoint(tmp_path / f"{seed}.pt", 1.0)
        state = checkpoints.read_checkpoint(path)
        state["network"] |= {f"body.0.{name}": value for name, value in layer.state_dict().items()}
        checkpoints.save_checkpoint(path, state)
        paths.append(path)
    average.average_checkpoints(paths, tmp_path / "m.pt")
    found = checkpoints.read_checkpoint(tmp_path / "m.pt")["network"]
    layer.load_state_dict({name: found[f"body.0.{name}"] for name in layer.state_dict()})
    torch.testing.assert_close(layer.weight(), (kernels[0] + kernels[1]) / 2, atol=1e-6, rtol=0)


def test_errors_are_one_line(tmp_path):
    one = checkpoint(tmp_path / "a.pt", 1.0)
    other = checkpoint(tmp_path / "b.pt", 1.0, network="lite")
    with pytest.raises(ValueError, match="give two or more"):
        average.average_checkpoints([one], tmp_path / "m.pt")
    with pytest.raises(ValueError, match="give runs of one network"):
        average.average_checkpoints([one, other], tmp_path / "m.pt")
    with pytest.raises(SystemExit, match=r"average: .*gone"):
        average.main([str(one), str(tmp_path / "gone.pt"), "-o", str(tmp_path / "m.pt")])
    assert not (tmp_path / "m.pt").exists()
