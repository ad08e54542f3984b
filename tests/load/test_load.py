import pytest

from ciir.service.cli import main
from tests.load import requests, run


def answered(status=200, statuses=None):
    return requests.LoadAnswer(status, 10.0, 5.0, statuses or (status,))


@pytest.mark.parametrize(
    ("answer", "holds"),
    [
        (answered(), True),
        (answered(200, (503, 429, 200)), True),  # with Retry-After
        (answered(500), False),
        (answered(200, (502, 200)), False),
        (answered(503), False),  # without
    ],
)
def test_undeclared_errors_are_counted(answer, holds):
    all_answered, undeclared = [
        line for line in run.summarise({0: answered(), 1: answer}, 2, 1.0) if line.holds is not None
    ]
    assert (all_answered.holds, undeclared.holds) == (True, holds)


@pytest.mark.parametrize(
    ("health", "last", "holds"), [(49.0, 109, [True, True]), (51.0, 109, [False, True]), (1.0, 111, [True, False])]
)
def test_health_and_memory_have_bounds(health, last, holds):
    seen = {
        "health_ms": [1.0] * 390 + [health] * 10,
        "bytes": [100 * 2**20] * 300 + [last * 2**20] * 100,
        "web_bytes": [50 * 2**20] * 400,
        "processes": [3] * 400,
    }
    assert [line.holds for line in run.check_samples(seen)] == [*holds, None]


@pytest.fixture
def small(tmp_path, monkeypatch):
    """One small request, and what the command line makes of it; the folders of answers and of what is made."""
    given = requests.small(0)
    monkeypatch.setattr(run, "make_request", lambda number: given)
    (tmp_path / given.name).write_bytes(given.data)
    options = [word for name, value in given.options.items() for word in (f"--{name}", value)]
    assert main.main(["reconstruct", str(tmp_path / given.name), "-o", str(tmp_path / "out.png"), *options]) == 0
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
def test_an_answer_is_compared_with_the_command_line(small, status, change, word):
    _, body, answers, made = small
    (answers / f"7-{status}").write_bytes(change(body))
    lines = run.list_differences([7], answers, made)
    assert [word in line for line in lines] == ([True] if word else [])


@pytest.mark.parametrize(("status", "lines"), [(422, 0), (200, 1), (500, 1), (429, 1), (409, 1)])
def test_what_the_command_line_refuses_must_be_refused(small, monkeypatch, status, lines):
    _, _, answers, made = small
    monkeypatch.setattr(run, "make_request", lambda number: requests.LoadRequest("bad", "a.off", b"x"))
    (answers / f"7-{status}").write_bytes(b"")
    assert len(run.list_differences([7], answers, made)) == lines
