import pytest

from ciir.benchmarks import speed
from ciir.models import processor


@pytest.fixture(autouse=True)
def bytes_of_no_mesh(monkeypatch):
    monkeypatch.setattr(speed.Bundle, "from_path", lambda path: None)


@pytest.mark.skipif(processor.int8_unsupported_reason() != "", reason=processor.int8_unsupported_reason())
def test_int8_networks_are_timed_against_their_twins(monkeypatch, capsys):
    monkeypatch.setattr(speed, "SIZES", ((8, 9),))
    assert speed.main(["--only", "int8", "--rounds", "1"]) == 0
    assert "fast-int8      9x8, 1 core(s): float" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("wanted", "ratio", "status"), [(None, None, 0), (1e6, 1e-6, 0), (0.0, None, 1), (None, 1e6, 1)]
)
def test_what_is_wanted_and_not_reached_is_an_error(wanted, ratio, status, monkeypatch, capsys):
    row = speed.Row("work", lambda: sum(range(1000)), wanted, {"other": (lambda: sum(range(1000)), ratio)}, factor=1000)
    monkeypatch.setitem(speed.ROWS, "view", lambda given: row)
    assert speed.main(["--only", "view", "--rounds", "1"]) == status
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "| what | ms | processor ms | wanted ms | times faster | wanted |"
    assert [line.split(" | ")[0] for line in lines[3:5]] == ["| work", "| - other"]


def test_commands_keep_their_compiled_files(monkeypatch):
    given = []
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("CIIR_WORKERS", "5")
    monkeypatch.setattr(speed.subprocess, "run", lambda command, env, **others: given.append(env))
    speed.run_command("scene:vase")
    assert "PYTHONDONTWRITEBYTECODE" not in given[0]
    assert given[0]["CIIR_WORKERS"] == "5"
