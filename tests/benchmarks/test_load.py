from collections import Counter
from types import SimpleNamespace

import pytest

from benchmarks import load, load_client, load_reference, load_requests
from benchmarks.fuzz import seeds
from benchmarks.load_client import Answered, form
from benchmarks.load_requests import AGAIN, asked, origin
from benchmarks.load_watch import descendants, resident
from service import cli
from service.web.upload import FILE


def test_kinds_are_mixed_and_some_are_asked_again():
    origins = [origin(number) for number in range(400)]
    kinds = Counter(kind for kind, _ in origins)
    assert kinds["small"] > kinds["mesh"] > kinds["array"] > 20
    assert kinds["bad"] > 20
    again = [number for number, (_, first) in enumerate(origins) if first != number]
    assert 10 <= len(again) <= 20
    assert all(origins[number] == origins[number - AGAIN] for number in again)


def test_requests_are_the_same_each_time_and_no_two_are_alike():
    numbers = {kind: [n for n in range(60) if origin(n) == (kind, n)][:3] for kind in load_requests.MAKERS}
    made = [asked(number) for listed in numbers.values() for number in listed]
    assert made == [asked(number) for listed in numbers.values() for number in listed]
    assert len({one.data for one in made}) == len(made) == 12


def answered(status=200, said=None, ms=10.0):
    return Answered(status, ms, 5.0, said or (status,))


@pytest.mark.parametrize(
    ("answer", "holds"),
    [
        (answered(), True),
        (answered(200, (503, 429, 200)), True),  # it said when to come again
        (answered(500), False),
        (answered(200, (502, 200)), False),
        (answered(503), False),  # it did not
    ],
)
def test_undeclared_faults_are_counted(answer, holds):
    all_answered, undeclared = [
        line for line in load.told({0: answered(), 1: answer}, 2, 1.0) if line.holds is not None
    ]
    assert (all_answered.holds, undeclared.holds) == (True, holds)


def test_a_request_without_an_answer_is_a_fault():
    assert next(load.told({0: answered()}, 2, 1.0)).holds is False


@pytest.mark.parametrize("status", [202, 409, 429, 503])
def test_no_request_is_asked_for_ever(monkeypatch, status):
    class Never:
        def request(self, *args):
            pass

        def getresponse(self):
            headers = {"Location": "/v1/reconstructions/x", "Retry-After": "0"}
            return SimpleNamespace(status=status, headers=headers, read=lambda: b"")

    monkeypatch.setattr(load_client, "ANSWER_SECONDS", 0.05)
    connection = load_client.Connection(1)
    connection._http = Never()
    assert connection.ask(b"")[0].status == status


@pytest.mark.parametrize(
    ("health", "last", "holds"), [(49.0, 109, [True, True]), (51.0, 109, [False, True]), (1.0, 111, [True, False])]
)
def test_health_and_memory_have_bounds(health, last, holds):
    seen = {
        "at": [0.0] * 400,
        "health_ms": [1.0] * 390 + [health] * 10,
        "bytes": [100 * 2**20] * 300 + [last * 2**20] * 100,
        "web_bytes": [50 * 2**20] * 400,
        "processes": [3] * 400,
    }
    assert [line.holds for line in load.watched(seen)] == [*holds, None]


def test_descendants_of_a_process():
    import os
    import subprocess
    import sys

    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        assert {os.getpid(), child.pid} <= set(descendants(os.getpid()))
        assert resident(os.getpid()) > 2**20
    finally:
        child.communicate(b"\n")
    assert resident(child.pid) == 0


@pytest.fixture
def small(tmp_path, monkeypatch):
    """One small request, and what the command line makes of it; the folders of answers and of what is made."""
    given = load_requests.small(0)
    monkeypatch.setattr(load_reference, "asked", lambda number: given)
    (tmp_path / given.name).write_bytes(given.data)
    options = [word for name, value in given.options.items() for word in (f"--{name}", value)]
    assert cli.main(["reconstruct", str(tmp_path / given.name), "-o", str(tmp_path / "out.png"), *options]) == 0
    for folder in ("answers", "made"):
        (tmp_path / folder).mkdir()
    return given, (tmp_path / "out.png").read_bytes(), tmp_path / "answers", tmp_path / "made"


@pytest.mark.parametrize(
    ("status", "change", "word"),
    [
        (200, lambda body: body, ""),
        (200, lambda body: body[:-1], "another picture"),
        (422, lambda body: b"{}", "answered 422, the command line makes it"),
    ],
)
def test_an_answer_is_held_against_the_command_line(small, status, change, word):
    _, body, answers, made = small
    (answers / f"7-{status}").write_bytes(change(body))
    lines = load_reference.differences([7], answers, made)
    assert [word in line for line in lines] == ([True] if word else [])


@pytest.mark.parametrize(("status", "lines"), [(422, 0), (200, 1), (500, 1), (429, 1), (409, 1)])
def test_what_the_command_line_refuses_must_be_refused(small, monkeypatch, status, lines):
    _, _, answers, made = small
    monkeypatch.setattr(load_reference, "asked", lambda number: load_requests.Asked("bad", "a.off", b"x"))
    (answers / f"7-{status}").write_bytes(b"")
    assert len(load_reference.differences([7], answers, made)) == lines


def test_the_views_of_a_zip_are_held_one_by_one(tmp_path):
    got = load_reference._pictures(seeds.zipped({"a.png": b"1", "b.png": b"2", "report.json": b"{}"}))
    assert got == {"a.png": b"1", "b.png": b"2"}


def test_a_form_holds_the_file_and_the_options():
    body = form(load_requests.small(3))
    assert f'name="{FILE}"; filename="small.off"'.encode() in body
    assert b'name="lenses"\r\n\r\n50x50\r\n' in body
