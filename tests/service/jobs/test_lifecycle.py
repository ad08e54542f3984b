import pytest

from ciir.service.jobs.job import Event, Problem, Result
from ciir.service.jobs.lifecycle import KILLER, MOST_ATTEMPTS

RESULT = Result("png", 6, {"timings_ms": {}})


def kept(jobs, run, data=b"result"):
    """The result file of a run, in its place."""
    with jobs.files.run(run.input, run.output) as place:
        place.target.write_bytes(data)
        place.keep()


def test_only_one_can_claim_a_job(jobs, helpers):
    job = helpers.submit(jobs)
    run = jobs.lifecycle.begin(job.id, "a-1")
    assert (run.state, run.claim, run.attempts) == ("running", "a-1", 1)
    assert jobs.lifecycle.begin(job.id, "b-1") is None
    assert jobs.lifecycle.begin("0" * 32, "b-1") is None
    assert jobs.running() == 1


def test_a_run_that_lost_its_claim_changes_nothing(jobs, helpers):
    job = helpers.submit(jobs)
    old = jobs.lifecycle.begin(job.id, "a-1")
    jobs.lifecycle.consumer_died(old)
    new = jobs.lifecycle.begin(job.id, "b-1")
    kept(jobs, old, b"late")
    assert not jobs.lifecycle.progress(old, {"stage": "map"})
    assert not jobs.lifecycle.finish(old, RESULT)
    jobs.lifecycle.again(old)
    jobs.lifecycle.worker_died(old)
    jobs.lifecycle.consumer_died(old)
    assert jobs.get(job.id) == new
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{job.input}"]
    kept(jobs, new)
    assert jobs.lifecycle.finish(new, RESULT)
    assert jobs.open_result(job.id).read() == b"result"


def test_a_cancelled_run_changes_nothing(jobs, helpers):
    run = jobs.lifecycle.begin(helpers.submit(jobs).id, "a-1")
    cancelled = jobs.cancel(run.id)
    kept_before = helpers.all_files(jobs.folder)
    assert not jobs.lifecycle.finish(run, Problem(422, "Title", "detail"))
    assert jobs.get(run.id) == cancelled
    assert kept_before == helpers.all_files(jobs.folder) == []


def test_an_end_that_was_told_twice_is_told_once(jobs, helpers):
    run = jobs.lifecycle.begin(helpers.submit(jobs).id, "a-1")
    kept(jobs, run)
    assert jobs.lifecycle.finish(run, RESULT)
    assert jobs.lifecycle.finish(run, RESULT)  # the first time the answer was lost on the way
    assert [event.kind for event in jobs.get(run.id).events] == ["queued", "running", "done"]
    assert jobs.open_result(run.id).read() == b"result"


def test_the_second_death_of_a_worker_fails_the_job(jobs, helpers):
    job = helpers.submit(jobs)
    jobs.queue.pop(("small",), 0.01)
    jobs.lifecycle.worker_died(jobs.lifecycle.begin(job.id, "a-1"))
    assert jobs.get(job.id).state == "queued"
    assert jobs.queue.pop(("small",), 0.01) == job.id
    jobs.lifecycle.worker_died(jobs.lifecycle.begin(job.id, "a-2"))
    ended = jobs.get(job.id)
    assert (ended.state, ended.problem, ended.deaths, ended.attempts) == ("failed", KILLER, 2, 2)
    assert KILLER.status == 422
    assert helpers.all_files(jobs.folder) == []
    assert helpers.submit(jobs) == ended


def test_a_job_that_takes_its_consumer_down_is_not_run_for_ever(jobs, helpers):
    job = helpers.submit(jobs)
    for number in range(MOST_ATTEMPTS):
        assert jobs.get(job.id).state == "queued"
        assert jobs.queue.pop(("small",), 0.01) == job.id
        jobs.lifecycle.consumer_died(jobs.lifecycle.begin(job.id, f"a-{number}"))
    assert jobs.get(job.id).problem.status == 503
    assert helpers.submit(jobs).state == "queued"


def test_what_was_stopped_in_good_order_is_run_as_often_as_it_takes(jobs, helpers):
    job = helpers.submit(jobs)
    for number in range(2 * MOST_ATTEMPTS):
        assert jobs.queue.pop(("small",), 0.01) == job.id
        jobs.lifecycle.again(jobs.lifecycle.begin(job.id, f"a-{number}"))
    assert jobs.get(job.id).state == "queued"


def test_a_run_that_died_leaves_nothing(jobs, helpers):
    job = helpers.submit(jobs)
    run = jobs.lifecycle.begin(job.id, "a-1")
    left = jobs.files.run(run.input, run.output)
    left.__enter__().target.write_bytes(b"half")
    jobs.lifecycle.consumer_died(run)
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{job.input}"]


def test_events_are_in_order_and_numbered_without_gaps(jobs, helpers):
    job = helpers.submit(jobs)
    run = jobs.lifecycle.begin(job.id, "a-1")
    assert jobs.lifecycle.progress(run, {"stage": "decode"})
    jobs.lifecycle.worker_died(run)
    run = jobs.lifecycle.begin(job.id, "a-2")
    assert jobs.lifecycle.progress(run, {"stage": "decode"})
    assert jobs.lifecycle.finish(run, Problem(415, "Title", "detail"))
    assert jobs.get(job.id).events == (
        Event("queued"),
        Event("running", {"attempt": 1}),
        Event("progress", {"stage": "decode"}),
        Event("queued"),
        Event("running", {"attempt": 2}),
        Event("progress", {"stage": "decode"}),
        Event("failed", {"status": 415, "title": "Title", "detail": "detail"}),
    )


@pytest.mark.parametrize("outcome", [RESULT, Problem(422, "Title", "detail")])
def test_a_settled_job_needs_no_looking_after(jobs, helpers, outcome):
    run = jobs.lifecycle.begin(helpers.submit(jobs).id, "a-1")
    assert jobs.lifecycle.finish(run, outcome)
    assert jobs.queue.active.items() == {}
    assert list(jobs.queue.kept.items()) == [run.input]
