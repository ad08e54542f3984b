import re
import sys

import pytest

torch = pytest.importorskip("torch", reason="needs the training extra")

from PIL import Image

from ciir.training.loop import logs
from ciir.training.loop.logs import Progress


def row(step, **losses):
    return {"step": step, "loss": 0.5, **losses, "learning_rate": 1e-3, "psnr": 30.0 + step, "seconds": 2.0 * step} | {
        "seconds_per_step": 0.25
    }


@pytest.fixture
def events():
    """The scalars in a folder of TensorBoard's, as name -> steps."""
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")

    def read(folder):
        found = accumulator.EventAccumulator(str(folder)).Reload()
        return {name: [event.step for event in found.Scalars(name)] for name in found.Tags()["scalars"]}

    return read


def test_a_row_is_in_the_csv_in_tensorboard_and_in_the_picture(tmp_path, events):
    log = logs.Log(tmp_path, title="a", step=0)
    log.add(row(2, l1=0.5))
    log.add(row(4, l1=0.25))
    text = (tmp_path / "log.csv").read_text().splitlines()
    assert text[0] == "step,loss,l1,learning_rate,psnr,seconds,seconds_per_step"
    assert text[2] == "4,0.5,0.25,0.001,34,8,0.25"
    assert logs.read_log(tmp_path / "log.csv") == [row(2, l1=0.5), row(4, l1=0.25)]
    with Image.open(tmp_path / "plot.png") as picture:
        assert picture.size == (900, 700)
    found = events(tmp_path / "tensorboard")
    assert found["losses/l1"] == found["psnr"] == [2, 4]


def test_rows_after_the_checkpoint_are_dropped(tmp_path, events):
    log = logs.Log(tmp_path, title="a", step=0)
    for step in (2, 4, 6):
        log.add(row(step))
    log = logs.Log(tmp_path, title="a", step=4)
    log.add(row(5))
    log.add(row(6))
    assert [r["step"] for r in logs.read_log(tmp_path / "log.csv")] == [2, 4, 5, 6]
    assert events(tmp_path / "tensorboard")["psnr"] == [2, 4, 5, 6]


@pytest.mark.parametrize("text", ["mine\n", "a,b\n1,2\n", "step,psnr\n1,x\n", "step,psnr\n1,2,3\n"])
def test_a_file_that_is_no_log(tmp_path, text):
    (tmp_path / "log.csv").write_text(text)
    if text == "mine\n":  # a header and no row
        assert logs.read_log(tmp_path / "log.csv") == []
        return
    with pytest.raises(ValueError, match=r"log\.csv: not the log of a run; move it away"):
        logs.Log(tmp_path, title="a", step=9)


@pytest.mark.parametrize(("package", "file"), [("tensorboard", "tensorboard"), ("matplotlib", "plot.png")])
def test_a_missing_package_costs_its_file_and_prints_one_note(tmp_path, monkeypatch, capsys, package, file):
    for name in [name for name in sys.modules if package in name.split(".")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    log = logs.Log(tmp_path, title="a", step=0)
    log.add(row(1))
    log.add(row(2))
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1
    assert f"no {file}: the package {package}" in shown
    assert len(logs.read_log(tmp_path / "log.csv")) == 2
    assert not (tmp_path / file).exists()


def test_progress_off_a_terminal_is_a_line_for_each_validation(capsys):
    with Progress(10, 110, 30.0) as progress:
        progress.count_step(0.5)
        progress.count_step(None)
        progress.report_validation(60, loss=0.25, psnr=33.333, pace=2.4, seconds=9.0)
    assert capsys.readouterr().err == "step 60 of 110: loss 0.25, PSNR 33.33 dB, 2.4 s a step, 02:00 left\n"


def test_the_time_left_of_a_run_by_the_clock(capsys):
    for seconds in (90.0, 1250.0):
        with Progress(0, 1_000_000, 30.0, minutes=20.5) as progress:
            progress.report_validation(60, loss=0.25, psnr=33.333, pace=2.4, seconds=seconds)
    with Progress(0, 100, 30.0, minutes=20.5) as progress:  # whose steps end before its minutes
        progress.report_validation(60, loss=0.25, psnr=33.333, pace=2.0, seconds=9.0)
    first, last, short = capsys.readouterr().err.splitlines()
    assert first.endswith(" 19:00 left")
    assert last.endswith(" 00:00 left")
    assert short.endswith(" 01:20 left")


def test_a_bar_of_a_run_by_the_clock_shows_the_time_left(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with Progress(0, 1_000_000, 30.0, minutes=20.5, seconds=600.0) as progress:
        progress.count_step(0.5)
    shown = capsys.readouterr().err
    assert re.search(r"loss 0\.5, PSNR 30\.00 dB, 10:(30|29) left", shown)
    assert "1000000" not in shown


def test_progress_on_a_terminal_shows_loss_and_psnr(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with Progress(0, 2, 30.0) as progress:
        progress.count_step(0.5)
        progress.count_step(0.25)
        progress.report_validation(2, loss=0.25, psnr=33.333, pace=2.4, seconds=9.0)
    shown = capsys.readouterr().err
    assert "2/2" in shown
    assert "loss 0.25, PSNR 30.00 dB" in shown
    assert "step 2 of 2" not in shown
