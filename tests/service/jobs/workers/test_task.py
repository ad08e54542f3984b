"""The work in this process: what it tells, and what it makes of what goes wrong."""

import errno
import json

import pytest

from ciir.models import catalogue
from ciir.service.jobs.job import Problem, Request, Result
from ciir.service.jobs.workers import sandbox, task
from ciir.service.jobs.workers.task import Task, TaskLimits, Teller, _is_memory, read_progress, run_task, warm_up
from ciir.service.pipeline import run
from ciir.service.settings import Settings
from tests.support.inputs import CUBE

FAST = {"lenses": "12x10", "pixels": "3x3", "model": "none", "backend": "raytrace"}


@pytest.fixture(autouse=True)
def this_process_stays_free(monkeypatch):
    monkeypatch.setattr(sandbox, "allow_cpu", lambda seconds: None)
    monkeypatch.setattr(task.tempfile, "tempdir", None)


@pytest.fixture
def given(tmp_path):
    (tmp_path / "input").write_bytes(CUBE)
    return Task("an id", Request("upload.off", FAST, None), tmp_path / "input", tmp_path / "result")


def done(given, **settings):
    return run_task(given, TaskLimits.from_settings(Settings(**settings)))


def raising(error):
    def fail(*args, **options):
        raise error

    return fail


def test_a_result_and_its_report(given):
    outcome = done(given).outcome
    assert isinstance(outcome, Result)
    assert (outcome.format, outcome.size, outcome.report) == ("png", given.target.stat().st_size, {})
    report = json.loads(given.report.read_bytes())
    assert report["plan"]["model"] == "none"
    assert "views" not in report  # 65,536 of them would be parsed whenever the job is looked at
    assert {path.name for path in given.target.parent.iterdir()} == {
        "input",
        "result",
        "result.progress",
        "result.report",
    }


def test_temporary_files_are_put_beside_the_result(given):
    done(given)
    assert task.tempfile.gettempdir() == str(given.target.parent)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"max_triangles": 11}, "12 triangles"),
        ({"max_output_pixels": 119}, "over the limit of 119"),
    ],
)
def test_the_settings_limits_hold(given, settings, words):
    outcome = done(given, **settings).outcome
    assert isinstance(outcome, Problem)
    assert outcome.status == 413
    assert words in outcome.detail


@pytest.mark.parametrize(
    ("error", "words", "expected"),
    [
        (OSError(errno.EFBIG, "x"), "the result is over 2,147,483,648 bytes", (413, False)),
        (OSError(errno.ENOSPC, "x"), "disk is full", (503, False)),
        (OSError(errno.EDQUOT, "x"), "disk is full", (503, False)),
        (OSError(errno.ENOMEM, "x"), "4,294,967,296 bytes of memory", (413, True)),
        (MemoryError(), "bytes of memory; give", (413, True)),
        (Exception("Failed to allocate memory for requested buffer"), "bytes of memory", (413, True)),
    ],
)
def test_what_a_machine_does_not_give(given, monkeypatch, error, words, expected):
    monkeypatch.setattr(run, "reconstruct", raising(error))
    found = done(given)
    assert (found.outcome.status, found.is_spent) == expected
    assert words in found.outcome.detail


@pytest.mark.parametrize("error", [OSError(errno.EIO, "x"), RuntimeError("x"), KeyError("x")])
def test_a_fault_of_ours_is_none_of_the_inputs(given, monkeypatch, error):
    monkeypatch.setattr(run, "reconstruct", raising(error))
    with pytest.raises(type(error)):
        done(given)


def test_memory_that_libraries_speak_of_in_words():
    assert _is_memory(RuntimeError("std::bad_alloc"))
    assert not _is_memory(RuntimeError("anything else"))
    later = ValueError("too large")
    assert not _is_memory(later)
    later.__cause__ = MemoryError()
    assert _is_memory(later)


def test_each_stage_is_told_once_and_views_now_and_then(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(task.time, "monotonic", lambda: now[0])
    path = tmp_path / "told"
    teller = Teller(path)
    for stage in ("decode", "render", "encode", "render"):
        with teller.stage(stage):
            pass
    teller.views = 5
    teller.done(1)  # too soon
    now[0] += task.PROGRESS_SECONDS
    teller.done(2)
    teller.done(1)  # too soon
    teller.done(1)  # the last is always told
    told, end = read_progress(path, 0)
    assert [(data["stage"], data["views_done"], data["views"]) for data in told] == [
        ("decode", 0, 0),
        ("render", 0, 0),
        ("encode", 0, 0),
        ("encode", 3, 5),
        ("encode", 5, 5),
    ]
    assert end == path.stat().st_size
    assert set(teller.timings_ms()) == {"decode", "render", "encode", "total"}


def test_progress_is_read_on_from_where_it_ended(tmp_path):
    path = tmp_path / "told"
    assert read_progress(path, 0) == ([], 0)
    path.write_bytes(b'{"a":1}\n{"a"')
    assert read_progress(path, 0) == ([{"a": 1}], 8)
    assert read_progress(path, 8) == ([], 8)
    with path.open("ab") as file:
        file.write(b':2}\n{"a":3}\n')
    assert read_progress(path, 8) == ([{"a": 2}, {"a": 3}], 24)


def test_both_models_that_auto_takes_are_run_before_a_worker_is_ready(stand_in, monkeypatch):
    ran = []

    def noted(load):
        return lambda name, **options: ran.append(name) or load(name, **options)

    for loader in ("load_upscaler", "load_light_field_network"):
        monkeypatch.setattr(catalogue, loader, noted(getattr(catalogue, loader)))
    call = type(stand_in).__call__
    monkeypatch.setattr(type(stand_in), "__call__", lambda *given, **more: ran.append("ran") or call(*given, **more))
    monkeypatch.setattr(sandbox, "missing", ["a limit"])
    assert warm_up() == ["a limit"]
    assert set(ran) == {"fast", "field", "ran"}
