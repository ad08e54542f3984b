import errno
import resource

import pytest

torch = pytest.importorskip("torch", reason="needs torch, of the training extra")

from ciir.training.loop import checkpoints

STATE = dict.fromkeys(checkpoints.KEYS, 1) | {"network": {"w": torch.ones(2)}}


def test_round_trip_leaves_no_partial_file(tmp_path):
    checkpoints.save_checkpoint(tmp_path / "checkpoint.pt", STATE)
    assert torch.equal(checkpoints.read_checkpoint(tmp_path / "checkpoint.pt")["network"]["w"], torch.ones(2))
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.pt"]


@pytest.mark.parametrize("value", [torch.inf, torch.nan])
def test_a_weight_that_is_not_a_number_is_not_saved(tmp_path, value):
    path = tmp_path / "checkpoint.pt"
    checkpoints.save_checkpoint(path, STATE)
    with pytest.raises(FloatingPointError, match="step 1: a weight is not a number"):
        checkpoints.save_checkpoint(path, STATE | {"optimiser": {"state": [{"m": torch.tensor([0, value])}]}})
    assert checkpoints.read_checkpoint(path)["optimiser"] == 1


def test_the_old_checkpoint_survives_a_full_disk(tmp_path):
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(b"old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError, match="large") as caught:
            checkpoints.save_checkpoint(path, STATE | {"network": {"w": torch.ones(2000)}})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.errno == errno.EFBIG
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("data", [b"", b"text", b"PK\x03\x04" + bytes(40), None])
def test_files_that_are_no_checkpoint(tmp_path, data):
    path = tmp_path / "checkpoint.pt"
    if data is None:
        torch.save({"weights": 1}, path)
    else:
        path.write_bytes(data)
    with pytest.raises(ValueError, match="not a checkpoint") as caught:
        checkpoints.read_checkpoint(path)
    assert str(path) in str(caught.value)
