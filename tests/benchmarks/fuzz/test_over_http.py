import email.message
from types import SimpleNamespace

import pytest

from benchmarks.fuzz import over_http

PROBLEM = "application/problem+json"


@pytest.mark.parametrize(
    ("status", "kind", "body", "fault"),
    [
        (200, "image/png", b"\x89PNG", ""),
        (422, PROBLEM, b'{"detail": "a line"}', ""),
        (404, PROBLEM, b"", ""),  # HEAD
        (500, PROBLEM, b'{"detail": "a line"}', "is no declared answer"),
        (418, PROBLEM, b'{"detail": "a line"}', "is no declared answer"),
        (400, "text/plain", b"Bad", "without a problem"),
        (422, PROBLEM, b'{"detail": "two\\nlines"}', "is no line"),
    ],
)
def test_answers_are_judged(status, kind, body, fault):
    headers = email.message.Message()
    headers["Content-Type"] = kind
    said = over_http._judged(SimpleNamespace(status=status, headers=headers), body)
    assert said.status == status
    assert fault in said.fault
    assert bool(said.fault) == bool(fault)


def test_faults_are_told():
    said = [over_http.Said(200), over_http.Said(422), over_http.Said(422), over_http.Said(500, "500 is no answer")]
    assert list(over_http.told(said)) == [
        "4 inputs: 200: 1, 422: 2, 500: 1",
        "1 answers that are not as declared",
        "500 is no answer",
    ]
