import pytest

from ciir.service.jobs.job import Event, Job, Problem, Request, Result, parse_id

JOB = Job("0" * 32, Request("upload.png", {"lenses": "5x5"}, None), created=1.5, lane="large", input="i", lease="l")


@pytest.mark.parametrize(
    "job",
    [
        JOB,
        JOB.add_event(Event("running", {"attempt": 1}), state="running").add_event(Event("progress", {"stage": "map"})),
        JOB.add_event(Event("failed"), state="failed", problem=Problem(422, "Not readable", "no file")),
        JOB.add_event(Event("done"), state="done", result=Result("zip", 5, {"views": [{"v": 1}], "notes": ["ü"]})),
    ],
)
def test_bytes_are_parsed_to_the_same_job(job):
    assert Job.from_bytes(job.to_bytes()) == job
    assert Job.from_bytes(job.to_bytes()).to_bytes() == job.to_bytes()


@pytest.mark.parametrize("text", [b"", b"{}", b"[]", b"\xff", b'{"problem": null, "result": null, "request": {}}'])
def test_other_bytes_are_refused(text):
    with pytest.raises((ValueError, LookupError, TypeError)):
        Job.from_bytes(text)


def test_no_two_runs_share_an_output():
    assert JOB.output == f"{'0' * 32}.l"
    assert parse_id(JOB.output) == JOB.id
    assert JOB.add_event(Event("running"), lease="m").output != JOB.output
