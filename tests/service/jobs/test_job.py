import pytest

from ciir.service.jobs.job import Event, Job, Problem, Request, Result

JOB = Job("0" * 32, Request("upload.png", {"lenses": "5x5"}, None), created=1.5, lane="large", input="i", claim="c")


@pytest.mark.parametrize(
    "job",
    [
        JOB,
        JOB.after(Event("running", {"attempt": 1}), state="running").after(Event("progress", {"stage": "map"})),
        JOB.after(Event("failed"), state="failed", problem=Problem(422, "Not readable", "no file")),
        JOB.after(Event("done"), state="done", result=Result("zip", 5, {"views": [{"v": 1}], "notes": ["ü"]})),
    ],
)
def test_there_and_back(job):
    assert Job.from_bytes(job.to_bytes()) == job
    assert Job.from_bytes(job.to_bytes()).to_bytes() == job.to_bytes()


@pytest.mark.parametrize("text", [b"", b"{}", b"[]", b"\xff", b'{"problem": null, "result": null, "request": {}}'])
def test_something_else(text):
    with pytest.raises((ValueError, LookupError, TypeError)):
        Job.from_bytes(text)


def test_no_two_runs_share_an_output():
    assert JOB.output == f"{'0' * 32}.c"
    assert JOB.after(Event("running"), claim="d").output != JOB.output
