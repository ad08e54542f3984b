import io
import json

import numpy as np
import pytest

from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.service.jobs.job import Problem, Result
from ciir.service.jobs.workers.messages import Done, parse_message, quote
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options

REPORT = {"timings_ms": {"total": 1.5}, "plan": {"skipped": {"pixels": 3, "uniform": 0.5}}}
RESULT = {"format": "png", "size": 3, "report": REPORT}
PROBLEM = {"status": 422, "title": "Not readable", "detail": "no file"}


def parse_outcome(outcome):
    message = {"kind": "done", "outcome": outcome, "is_out_of_memory": False}
    return parse_message(json.dumps(message).encode())


def test_outcomes_are_parsed():
    assert parse_outcome(RESULT) == Done(kind="done", outcome=Result("png", 3, REPORT), is_out_of_memory=False)
    assert parse_outcome(PROBLEM).outcome == Problem(422, "Not readable", "no file")
    assert parse_outcome(RESULT | {"report": {"timings_ms": {}}}).outcome.report == {"timings_ms": {}}


def test_the_report_of_a_view_whose_pixels_were_all_skipped_is_parsed():
    black = Bundle.from_upload("black.png", encode_png(np.zeros((40, 40, 3), np.uint8)))
    with FileWriter(io.BytesIO(), "png") as writer:
        options = Options.parse({"lenses": "20x20", "model": "fast"})
        report = json.loads(json.dumps({**pipeline.reconstruct(black, options, writer), "views": None}))
    assert report["plan"]["skipped"]["uniform"] == 1
    assert parse_outcome(RESULT | {"report": report}).outcome.report == report


@pytest.mark.parametrize(
    "outcome",
    [
        PROBLEM | {"status": 200},
        PROBLEM | {"status": "many"},
        PROBLEM | {"title": None},
        PROBLEM | {"detail": "half a pair: \ud800"},
        RESULT | {"format": "exe"},
        RESULT | {"report": []},
        RESULT | {"report": {}},
        RESULT | {"report": REPORT | {"more": float("nan")}},
        RESULT | {"report": REPORT | {"timings_ms": {"total": -1}}},
        RESULT | {"report": REPORT | {"timings_ms": {"total": "1"}}},
        RESULT | {"report": REPORT | {"timings_ms": {"a\r\nHeader: b": 1}}},
        RESULT | {"report": REPORT | {"plan": 3}},
        RESULT | {"report": REPORT | {"plan": {"skipped": {"pixels": -3}}}},
        RESULT | {"report": REPORT | {"plan": {"skipped": {"pixels": None}}}},
        RESULT | {"report": REPORT | {"plan": {"skipped": {"pixels": 3}}}},
        RESULT | {"report": REPORT | {"plan": {"skipped": {"reasons": 3}}}},
        RESULT | {"report": REPORT | {"timings_ms": {"total": 1e300}}},
        RESULT | {"report": REPORT | {"more": 10**400}},
        RESULT | {"size": -1},
        None,
    ],
)
def test_other_outcomes_are_refused(outcome):
    with pytest.raises(ValueError, match=r"."):
        parse_outcome(outcome)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{}",
        b"[]",
        b"\xff",
        b"\x80\x04N.",
        b"[" * 100_000,
        b'{"kind": "other"}',
        b'{"kind": "started", "more": 1}',
        b'{"kind": "progress", "stage": "rest", "views_done": 0, "views": 0}',
        b'{"kind": "progress", "stage": "plan", "views_done": -1, "views": 0}',
        b'{"kind": "progress", "stage": "plan", "views_done": 1e999, "views": 0}',
    ],
)
def test_other_lines_are_refused(line):
    with pytest.raises(ValueError, match=r"."):
        parse_message(line)


def test_the_text_of_a_problem_is_one_printable_line():
    forged = parse_outcome(PROBLEM | {"title": "a\n2026 ERROR b", "detail": "\x1b[2J\u2028" + 9000 * "x"}).outcome
    assert forged.title == "a?2026 ERROR b"
    assert forged.detail == "?[2J?" + 3995 * "x"


def test_quoted_text_has_no_line_of_its_own():
    assert quote("a\n2026 ERROR b\r\x1b[2J\u2028c") == "| a\n| 2026 ERROR b\n| ?[2J\n| c"
    assert quote("x" * 20, limit=5) == "| xxxxx"
