import pytest

from benchmarks.fuzz import run


def test_a_target_is_fuzzed_and_its_inputs_are_counted(tmp_path):
    pytest.importorskip("atheris", reason="atheris is not installed: pip install atheris")
    tally = run.fuzz("off", tmp_path / "off", inputs=500, seconds=60, seed=1)
    assert tally.inputs == tally.read + tally.refused == 500
    assert min(tally.read, tally.refused) > 0
    assert tally.findings == ()
    assert len(list((tmp_path / "off" / "corpus").iterdir())) > 2


def test_findings_count_as_inputs_and_end_with_1(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(run, "fuzz", lambda name, folder, **more: run.Tally(2, 3, ("crash-1",)))
    assert run.main(["off", "--folder", str(tmp_path)]) == 1
    out = capsys.readouterr().out
    assert "6 inputs:" in out
    assert "1 findings crash-1" in out


def test_no_findings_end_with_0(monkeypatch, tmp_path):
    monkeypatch.setattr(run, "fuzz", lambda name, folder, **more: run.Tally(2, 3, ()))
    assert run.main(["--folder", str(tmp_path)]) == 0


def test_a_target_that_is_none(capsys):
    with pytest.raises(SystemExit):
        run.main(["exr"])
    assert "exr: no such target; known are png" in capsys.readouterr().err
