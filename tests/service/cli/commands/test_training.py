import pytest

from tests.support.cli import fails
from tests.support.paths import ROOT
from tests.support.servers import run_python

WITHOUT_TORCH = """
import sys
from ciir.service.cli.main import main
sys.modules["torch"] = None
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("command", ["train", "export"])
def test_training_without_torch_names_the_remedy(tmp_path, command):
    (tmp_path / "c.pt").write_bytes(b"")
    given = {"train": ROOT / "training" / "recipes" / "fast-first.toml", "export": tmp_path / "c.pt"}[command]
    done = run_python("-c", WITHOUT_TORCH, command, given, "-o", tmp_path / "out")
    assert (done.returncode, done.stdout) == (2, "")
    assert "pip install '.[training]'" in done.stderr


def test_a_degradation_needs_pictures(tmp_path, capsys):
    (tmp_path / "c.pt").write_bytes(b"")
    given = ["export", tmp_path / "c.pt", "-o", tmp_path / "out", "--degradation", "box"]
    assert "--degradation: this goes with --on" in fails(capsys, *given)
