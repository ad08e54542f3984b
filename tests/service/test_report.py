import json

import pytest

from service import report
from service.report import Clock, CountedFiles


def test_clock_sums_turns_and_names_only_what_ran(monkeypatch):
    now = iter([0.0, 1.0, 3.0, 4.0, 4.5, 10.0])
    monkeypatch.setattr(report.time, "perf_counter", lambda: next(now))
    clock = Clock()
    for _ in range(2):
        with clock.stage("decode"):
            pass
    assert clock.timings_ms() == {"decode": 2500.0, "total": 10000.0}


def test_clock_counts_what_fails():
    clock = Clock()
    with pytest.raises(KeyError), clock.stage("map"):
        raise KeyError
    assert set(clock.timings_ms()) == {"map", "total"}


def test_counts_what_was_read_once():
    files = CountedFiles({"a": b"123", "b": b"45678"})
    assert "a" in files
    assert files["a"] == files["a"]
    assert (files.bytes_read, files.files_read) == (3, 1)
    assert list(files) == ["a", "b"]


def test_json_is_utf8_and_refuses_nan():
    assert json.loads(report.to_json({"name": "Würfel"})) == {"name": "Würfel"}
    with pytest.raises(ValueError, match="Out of range"):
        report.to_json({"x": float("nan")})
