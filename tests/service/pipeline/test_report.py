from threading import Thread

import pytest

from ciir.service.pipeline import report
from ciir.service.pipeline.report import Clock, CountedFiles


def test_clock_sums_turns_and_names_only_what_ran(monkeypatch):
    now = iter([0.0, 1.0, 3.0, 4.0, 4.5, 10.0])
    monkeypatch.setattr(report.time, "perf_counter", lambda: next(now))
    clock = Clock()
    for _ in range(2):
        with clock.stage("decode"):
            pass
    assert clock.timings_ms() == {"decode": 2500.0, "total": 10000.0}


def test_a_stage_within_another_is_not_counted_twice(monkeypatch):
    now = iter([0.0, 1.0, 2.0, 4.0, 5.0, 5.5, 6.0, 10.0])
    monkeypatch.setattr(report.time, "perf_counter", lambda: next(now))
    clock = Clock()
    with clock.stage("encode"):
        for _ in range(2):
            with clock.stage("focus"):
                pass
    assert clock.timings_ms() == {"focus": 2500.0, "encode": 2500.0, "total": 10000.0}


def test_stages_of_two_threads_overlap(monkeypatch):
    now = iter([0.0, 1.0, 3.0, 4.0, 5.0, 6.0])
    monkeypatch.setattr(report.time, "perf_counter", lambda: next(now))
    clock = Clock()

    def encode():
        with clock.stage("encode"):
            pass

    with clock.stage("render"):
        thread = Thread(target=encode)
        thread.start()
        thread.join()
    assert clock.timings_ms() == {"render": 4000.0, "encode": 1000.0, "total": 6000.0}


def test_clock_counts_what_fails():
    clock = Clock()
    with pytest.raises(KeyError), clock.stage("map"):
        raise KeyError
    assert set(clock.timings_ms()) == {"map", "total"}


def test_counts_what_was_read_once():
    files = CountedFiles({"a": b"123", "b": b"45678"})
    assert "a" in files
    assert files["a"] == files["a"]
    assert files.sizes == {"a": 3}
    assert list(files) == ["a", "b"]
    assert files.read_start("b", 2) == b"45"
    assert files.sizes == {"a": 3}


def test_the_line_on_skipping():
    nothing = {"pixels": 10, "uniform": 0.0}
    assert (
        report.skip_reasons(None)
        == report.skip_reasons(nothing)
        == report.skip_reasons(nothing | {"culled": 0.0})
        == []
    )
    assert report.skip_reasons({"culled": 0.25}) == ["skipped: 25 % of the triangles, which no ray meets"]
    assert report.skip_reasons(nothing | {"uniform": 0.302}) == [
        "skipped: the model for 30 % of its pixels, which are uniform background"
    ]
    assert report.skip_reasons({"culled": 0.9988}) == ["skipped: over 99 % of the triangles, which no ray meets"]
    assert report.skip_reasons(nothing | {"uniform": 1.0}) == [
        "skipped: the model for 100 % of its pixels, which are uniform background"
    ]
    (both,) = report.skip_reasons(nothing | {"uniform": 0.5, "culled": 0.001})
    assert both == (
        "skipped: under 1 % of the triangles, which no ray meets, and the model for 50 % of its pixels, which are "
        "uniform background"
    )
