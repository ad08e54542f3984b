"""A batch on worker processes of this machine, by the command."""

import csv
import errno
import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.light_field import LightField
from ciir.renderer.writers.pictures import encode_png
from ciir.service.batch import parts, places
from ciir.service.batch.task import Request, Task
from ciir.service.batch.work import work
from ciir.service.cli.commands import batch as command
from ciir.service.cli.main import main
from ciir.service.pipeline.options import Options
from tests.support.inputs import CUBE
from tests.support.light_fields import make_views

pytestmark = pytest.mark.usefixtures("workers_in_this_process")
ARRAY = ("--lenses", "12x12", "--pixels", "3x3", "--model", "fast")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Inputs, one of them broken, and a finished batch of them."""
    folder = tmp_path_factory.mktemp("batch")
    (folder / "in" / "arrays").mkdir(parents=True)
    for seed, name in enumerate(("vase", "globe")):
        array = LightField(make_views((3, 3), side=12, channels=3, seed=seed)).eia()
        (folder / "in" / "arrays" / f"{name}.png").write_bytes(encode_png(array))
    (folder / "in" / "cube.off").write_bytes(CUBE)
    (folder / "in" / "broken.png").write_bytes((folder / "in" / "arrays" / "vase.png").read_bytes()[:100])
    with pytest.raises(SystemExit) as end:
        run(folder)
    assert end.value.code == 3
    return folder


def run(folder, *more, out="out"):
    return main(["batch", str(folder / "in"), "-o", str(folder / out), "--workers", "1", *ARRAY, *more])


def read_summary(folder, out="out"):
    summary = json.loads((folder / out / "summary.json").read_bytes())
    return summary, {row["output"]: row for row in summary["results"]}


def test_one_bad_file_does_not_stop_the_others(folder):
    summary, rows = read_summary(folder)
    assert {key: summary[key] for key in ("inputs", "done", "kept", "failed", "not_done")} == {
        "inputs": 4,
        "done": 3,
        "kept": 0,
        "failed": 1,
        "not_done": 0,
    }
    assert "ends too early" in rows["broken"]["error"]
    assert rows["arrays/vase"] | {"seconds": 0} == {
        "input": str(folder / "in" / "arrays" / "vase.png"),
        "output": "arrays/vase",
        "status": "done",
        "error": "",
        "views": 1,
        "model": "fast",
        "seconds": 0,
        "notes": rows["arrays/vase"]["notes"],
    }
    with (folder / "out" / "summary.csv").open() as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["done", "done", "failed", "done"]


def test_what_another_worker_did_in_this_run_counts_as_done(folder):
    request = Request(Options(lenses=(12, 12), pixels=(3, 3), model="none"), str(folder / "twice"), "one run")
    task = Task(str(folder / "in" / "arrays" / "vase.png"), "vase")
    assert [work(task, request).status for _ in range(2)] == ["done", "done"]
    assert work(task, replace(request, run="another")).status == "kept"


def test_a_full_disk_is_named(folder, tmp_path, monkeypatch, capsys):
    """Of an input's output, and of the summary, without which the exit status is that of a batch that did not end."""

    def fail(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(places, "replacing", fail)
    assert main(["batch", str(folder / "in" / "cube.off"), "-o", str(tmp_path), "--workers", "1", *ARRAY]) == 1
    error = f"{tmp_path}: No space left on device; make room there, and run the batch again"
    assert capsys.readouterr().err.splitlines() == [f"ciir: {folder / 'in' / 'cube.off'}: {error}", f"ciir: {error}"]


@pytest.mark.parametrize("left", [0, 100])
@pytest.mark.parametrize("out", ["vase", "vase.png"])
def test_an_output_that_was_cut_off_is_made_anew(folder, tmp_path, out, left):
    request = Request(Options(lenses=(12, 12), pixels=(3, 3), model="none"), str(tmp_path))
    task = Task(str(folder / "in" / "arrays" / "vase.png"), out, is_file="." in out)
    work(task, request)
    view = tmp_path / out if task.is_file else tmp_path / out / "view_01_01.png"
    whole = view.read_bytes()
    view.write_bytes(whole[:left])
    assert [work(task, request).status for _ in range(2)] == ["done", "kept"]
    assert view.read_bytes() == whole


@pytest.mark.parametrize("others", [(), ("mine.txt",)])
def test_an_earlier_output_leaves_no_empty_folder(folder, tmp_path, others):
    request = Request(Options(lenses=(12, 12), pixels=(3, 3), model="none"), str(tmp_path / "out"), "one run")
    source = tmp_path / "vase.png"
    shutil.copy(folder / "in" / "arrays" / "vase.png", source)
    assert work(Task(str(source), "vase"), request).status == "done"
    for other in others:
        (tmp_path / "out" / "vase" / other).touch()
    source.write_bytes(source.read_bytes()[:100])
    assert work(Task(str(source), "vase"), request).status == "failed"
    left = [path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").glob("vase/**/*")]
    assert left == [f"vase/{other}" for other in others]
    assert (tmp_path / "out" / "vase").exists() is bool(others)


@pytest.mark.parametrize(
    ("given", "reason"), [("gone.png", "No such file"), ("white.txt", "white: white.txt is not a picture")]
)
def test_a_frame_that_cannot_be_read_is_refused_before_any_work(tmp_path, monkeypatch, capsys, given, reason):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "white.txt").touch()
    (tmp_path / "cube.off").write_bytes(CUBE)
    assert main(["batch", "cube.off", "-o", "out", "--white", given, *ARRAY]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("ciir: ")
    assert reason in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("out", ["memory://out", "simplecache::memory://out"])
def test_outputs_in_memory_are_refused(capsys, out):
    assert main(["batch", "scene:vase", "-o", out, *ARRAY]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"ciir: {out}: files in memory are lost when the command ends; give a folder")


@pytest.mark.parametrize("given", [".", "in", "../in/"])
def test_outputs_in_an_input_are_refused_before_they_are_inputs(tmp_path, monkeypatch, capsys, given):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "cube.off").write_bytes(CUBE)
    monkeypatch.chdir(tmp_path / "in" if given.startswith(".") else tmp_path)
    out = str(tmp_path / "in" / "out")
    assert main(["batch", given, "-o", out, "--workers", "1", *ARRAY]) == 2
    assert f"{out}: this lies in the input {given} and would be read as a part of it; give another folder" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "in" / "out").exists()


@pytest.mark.parametrize(
    ("given", "out"),
    [
        ("safe/a.off", "safe"),
        ("link/a.off", "safe"),
        ("link/*.off", "safe"),
        ("other/../safe/a.off", "safe"),
        ("safe/a.off", "other/../link"),
        ("safe/a.off", "file://safe"),
        ("file://link/a.off", "safe/"),
        ("other/a.off", "safe"),  # a link to the file
        ("other/a.off", "other"),
    ],
)
def test_outputs_where_an_input_is_are_refused_however_both_are_named(tmp_path, monkeypatch, capsys, given, out):
    for name in ("safe", "other"):
        (tmp_path / name).mkdir()
    (tmp_path / "safe" / "a.off").write_bytes(CUBE)
    (tmp_path / "link").symlink_to("safe")
    (tmp_path / "other" / "a.off").symlink_to("../safe/a.off")
    monkeypatch.chdir(tmp_path)
    assert main(["batch", given, "-o", out, "--name", "{path}.png", "--workers", "1", *ARRAY]) == 2
    assert f"{out}: the input {tmp_path}" in capsys.readouterr().err
    assert (tmp_path / "safe" / "a.off").read_bytes() == CUBE
    assert sorted(path.name for path in tmp_path.glob("*/*") if path.name != "a.off") == []


def test_a_scene_is_no_file_of_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["batch", "scene:vase", "-o", ".", "--workers", "1", *ARRAY]) == 0


def test_results_are_those_of_reconstruct(folder, tmp_path):
    for name in ("arrays/globe.png", "cube.off"):
        assert main(["reconstruct", str(folder / "in" / name), "-o", str(tmp_path / name[:4]), *ARRAY]) == 0
        expected = {path.name: path.read_bytes() for path in (tmp_path / name[:4]).glob("*.png")}
        found = {path.name: path.read_bytes() for path in (folder / "out" / name).with_suffix("").glob("*.png")}
        assert found == expected
        assert expected


def test_what_is_done_is_not_done_again(folder, capsys):
    shutil.copytree(folder, folder / "copy")
    (folder / "copy" / "in" / "broken.png").unlink()
    (folder / "copy" / "out" / "cube" / "view_01_01.png").unlink()
    source, target = (folder / "copy" / "in" / "arrays" / name for name in ("globe.png", "vase.png"))
    target.write_bytes(source.read_bytes())
    (folder / "copy" / "out" / ".batch" / "scratch" / "of_a_killed_worker").mkdir(parents=True)
    assert run(folder / "copy") == 0
    _, rows = read_summary(folder / "copy")
    assert {name: row["status"] for name, row in rows.items()} == {
        "arrays/globe": "kept",
        "arrays/vase": "done",
        "cube": "done",
    }
    out = folder / "copy" / "out"
    assert (out / "arrays/vase/view_01_01.png").read_bytes() == (out / "arrays/globe/view_01_01.png").read_bytes()
    assert sorted(path.name for path in (out / ".batch").iterdir()) == ["lock", "records"]
    assert "2 of 3 inputs done, 1 done before" in capsys.readouterr().out


def test_a_white_frame_that_is_given_later_counts(tmp_path, capsys):
    light = np.random.default_rng(0).integers(60, 200, (80, 80, 3), dtype=np.uint8)
    for name, pixels in (("raw.png", light), ("white.png", light // 2 + 90)):
        (tmp_path / name).write_bytes(encode_png(pixels))
    grid = ("--lens-pitch", "10", "--lens-offset", "4.5,4.5", "--lens-rotation", "0", "--lens-grid", "square")
    options = (*grid, "--pixels", "5x5", "--model", "none", "--workers", "1")
    for more, said in (((), "1 of 1 inputs done"), (("--white", str(tmp_path / "white.png")), "1 of 1 inputs done")):
        assert main(["batch", str(tmp_path / "raw.png"), "-o", str(tmp_path / "out"), *options, *more]) == 0
        assert said in capsys.readouterr().out


@pytest.mark.parametrize("content", [b'{"out": "cube", "k', b'{"key": 1}', b"[]", b""])
def test_what_has_a_damaged_record_is_made_anew(folder, content):
    copy = folder / f"copy of {len(content)}"
    shutil.copytree(folder / "in", copy / "in")
    shutil.copytree(folder / "out", copy / "out")
    (copy / "in" / "broken.png").unlink()
    (record,) = (
        path for path in (copy / "out" / ".batch" / "records").iterdir() if '"out": "cube"' in path.read_text()
    )
    record.write_bytes(content)
    (view,) = (copy / "out" / "cube").glob("*.png")
    before, stale = view.read_bytes(), view.with_name("view_00_09.png")
    report = json.loads((copy / "out" / "cube" / "report.json").read_text())
    report["views"].append(report["views"][0] | {"file": stale.name})
    other = copy / "out" / "mine.png"
    other.write_bytes(before)
    report["views"].append(report["views"][0] | {"file": "../mine.png"})  # which is not the output's
    (copy / "out" / "cube" / "report.json").write_text(json.dumps(report))
    stale.write_bytes(before)
    view.write_bytes(b"")
    assert run(copy) == 0
    _, rows = read_summary(copy)
    assert rows["cube"]["status"] == "done"
    assert view.read_bytes() == before
    assert not stale.exists()
    assert other.exists()


def test_a_large_light_field_goes_through_the_engine_in_parts(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "PART_PIXELS", 4 * 24 * 24)
    source, views = str(folder / "in" / "arrays" / "vase.png"), ("--views", "all")
    assert main(["batch", source, "-o", str(tmp_path / "out"), "--workers", "1", *ARRAY, *views]) == 0
    monkeypatch.undo()
    assert main(["reconstruct", source, "-o", str(tmp_path / "whole"), *ARRAY, *views]) == 0
    made, expected = (
        {path.name: path.read_bytes() for path in (tmp_path / name).glob("*.png")} for name in ("out/vase", "whole")
    )
    assert made == expected
    assert len(made) == 9
    reasons = json.loads((tmp_path / "out" / "vase" / "report.json").read_bytes())["plan"]["reasons"]
    assert "made in 3 parts, whose times are added up" in reasons


def test_errors_name_options_as_they_are_typed(tmp_path, capsys):
    (tmp_path / "all_in_focus.png").write_bytes(encode_png(make_views((1, 1), side=40, channels=3)[0, 0]))
    source = str(tmp_path / "all_in_focus.png")
    with pytest.raises(SystemExit):
        main(["batch", source, "-o", str(tmp_path / "out"), "--workers", "1", "--lens-pitch", "auto"])
    errors = capsys.readouterr().err
    assert f"ciir: {source}: shows no lens grid" in errors
    assert "leave --lens-pitch out" in errors
    assert "lens_pitch" not in errors


def test_a_joined_report_has_the_reasons_and_notes_of_every_part():
    def make_report(reason, note):
        plan = {"reasons": ["one for all", reason, "skipped: some pixels"]}
        return {"plan": plan, "notes": [note], "views": [], "options": {}, "timings_ms": {"total": 2.0}}

    joined = parts._join_reports([make_report("a", "x"), make_report("b", "x")], Options())
    assert joined["plan"]["reasons"] == ["one for all", "a", "b", "made in 2 parts, whose times are added up"]
    assert (joined["notes"], joined["timings_ms"]) == (["x"], {"total": 4.0})


@pytest.mark.parametrize("error", ["broken.png: it ends", "it ends", "/in/broken.png: it ends"])
def test_an_error_names_its_input_once(error):
    assert command._name_once("/in/broken.png", error) == "/in/broken.png: it ends"
