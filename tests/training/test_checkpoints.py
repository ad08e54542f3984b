import pytest

torch = pytest.importorskip("torch", reason="needs torch, of the training extra")

from training import checkpoints
from training.networks import make


def test_round_trip_leaves_no_partial_file(tmp_path):
    state = dict.fromkeys(checkpoints.KEYS, 1) | {"network": {"w": torch.ones(2)}}
    checkpoints.save(tmp_path / "checkpoint.pt", state)
    assert torch.equal(checkpoints.read(tmp_path / "checkpoint.pt")["network"]["w"], torch.ones(2))
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.pt"]


@pytest.mark.parametrize("data", [b"", b"text", b"PK\x03\x04" + bytes(40), None])
def test_what_is_no_checkpoint(tmp_path, data):
    path = tmp_path / "checkpoint.pt"
    if data is None:
        torch.save({"weights": 1}, path)
    else:
        path.write_bytes(data)
    with pytest.raises(ValueError, match="not a checkpoint") as caught:
        checkpoints.read(path)
    assert str(path) in str(caught.value)


def test_networks_that_are_not_known():
    with pytest.raises(ValueError, match="'vdsr' is not known; give one of compact, lite"):
        make("vdsr", {})
    with pytest.raises(ValueError, match="lite doesn't take"):
        make("lite", {"bloks": 3})
