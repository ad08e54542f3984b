import pytest

from ciir.service.jobs.job import Event, Problem
from ciir.service.jobs.lifecycle import ATTEMPT_LIMIT, describe_deaths
from tests.support.jobs import list_files, make_result, publish_result, read_result, submit_data

RESULT = make_result()


def test_only_one_run_gets_a_lease(jobs):
    job = submit_data(jobs)
    run = jobs.lifecycle.start(job.id, "a-1")
    assert (run.state, run.lease, run.attempts) == ("running", "a-1", 1)
    assert jobs.lifecycle.start(job.id, "b-1") is None
    assert jobs.lifecycle.start("0" * 32, "b-1") is None
    assert [seconds < 60 for seconds in jobs.measure_ages()["small", "running"]] == [True]


def test_a_run_that_lost_its_lease_changes_nothing(jobs):
    job = submit_data(jobs)
    old = jobs.lifecycle.start(job.id, "a-1")
    jobs.lifecycle.retry_after_consumer_death(old)
    new = jobs.lifecycle.start(job.id, "b-1")
    publish_result(jobs, old, b"late")
    assert not jobs.lifecycle.add_progress(old, {"stage": "map"})
    assert not jobs.lifecycle.finish(old, RESULT)
    jobs.lifecycle.requeue(old, "large")
    jobs.lifecycle.retry_after_worker_death(old, timed_out=False)
    jobs.lifecycle.retry_after_consumer_death(old)
    assert jobs.get(job.id) == new
    assert list_files(jobs) == [f"inputs/{job.input}"]
    publish_result(jobs, old)
    publish_result(jobs, new)
    assert jobs.lifecycle.finish(new, RESULT)
    assert read_result(jobs, job.id) == b"result"
    assert not jobs.lifecycle.finish(old, RESULT)  # although the outcome is the same
    assert list_files(jobs) == [f"results/{new.output}"]


def test_a_move_to_another_lane_is_no_warning(jobs, caplog):
    run = jobs.lifecycle.start(submit_data(jobs).id, "a-1")
    jobs.lifecycle.requeue(run, "large")
    assert jobs.get(run.id).lane == "large"
    assert [record for record in caplog.records if record.levelname == "WARNING"] == []
    jobs.lifecycle.retry_after_consumer_death(jobs.lifecycle.start(run.id, "a-2"))
    assert "run 2 was stopped; queued again" in caplog.text


def test_a_cancelled_run_changes_nothing(jobs):
    run = jobs.lifecycle.start(submit_data(jobs).id, "a-1")
    cancelled = jobs.cancel(run.id)
    assert list_files(jobs) == []
    assert not jobs.lifecycle.finish(run, Problem(422, "Title", "detail"))
    assert jobs.get(run.id) == cancelled
    assert list_files(jobs) == []


def test_finish_may_be_repeated(jobs):
    run = jobs.lifecycle.start(submit_data(jobs).id, "a-1")
    publish_result(jobs, run)
    assert jobs.lifecycle.finish(run, RESULT)
    assert jobs.lifecycle.finish(run, RESULT)  # as if the first answer was lost
    assert [event.kind for event in jobs.get(run.id).events] == ["queued", "running", "done"]
    assert read_result(jobs, run.id) == b"result"


@pytest.mark.parametrize(
    ("cause", "why"),
    [
        ("", ", because the server lacked memory or time, or the input crashed it; submit"),
        ("it was not done after 8 s", ", in the last one because it was not done after 8 s; submit"),
    ],
)
def test_the_second_death_of_a_worker_fails_the_job(jobs, cause, why):
    job = submit_data(jobs)
    jobs.queue.pop(("small",), 0.01)
    jobs.lifecycle.retry_after_worker_death(jobs.lifecycle.start(job.id, "a-1"), timed_out=True)
    assert (jobs.get(job.id).state, jobs.get(job.id).has_timed_out) == ("queued", True)
    assert jobs.queue.pop(("small",), 0.01) == job.id
    jobs.lifecycle.retry_after_worker_death(jobs.lifecycle.start(job.id, "a-2"), timed_out=False, cause=cause)
    ended = jobs.get(job.id)
    assert (ended.state, ended.problem, ended.worker_deaths, ended.attempts) == (
        "failed",
        describe_deaths(cause),
        2,
        2,
    )
    assert ended.problem.status == 503  # the machine may be short of memory
    assert f"the worker process was stopped in 2 runs{why} again later" in ended.problem.detail
    assert list_files(jobs) == []
    again = submit_data(jobs)
    assert (again.state, again.worker_deaths) == ("queued", 0)


def test_a_job_whose_consumer_always_dies_is_not_run_for_ever(jobs):
    job = submit_data(jobs)
    for number in range(ATTEMPT_LIMIT):
        assert jobs.get(job.id).state == "queued"
        assert jobs.queue.pop(("small",), 0.01) == job.id
        jobs.lifecycle.retry_after_consumer_death(jobs.lifecycle.start(job.id, f"a-{number}"))
    assert jobs.get(job.id).problem.status == 503
    assert submit_data(jobs).state == "queued"


def test_a_job_may_be_requeued_any_number_of_times(jobs):
    job = submit_data(jobs)
    for number in range(2 * ATTEMPT_LIMIT):
        assert jobs.queue.pop(("small",), 0.01) == job.id
        jobs.lifecycle.requeue(jobs.lifecycle.start(job.id, f"a-{number}"), "small")
    assert jobs.get(job.id).state == "queued"


def test_events_are_in_order_and_none_is_lost(jobs):
    job = submit_data(jobs)
    run = jobs.lifecycle.start(job.id, "a-1")
    assert jobs.lifecycle.add_progress(run, {"stage": "decode"})
    jobs.lifecycle.retry_after_worker_death(run, timed_out=False)
    run = jobs.lifecycle.start(job.id, "a-2")
    assert jobs.lifecycle.add_progress(run, {"stage": "decode"})
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
def test_an_ended_job_is_settled(jobs, outcome):
    run = jobs.lifecycle.start(submit_data(jobs).id, "a-1")
    assert jobs.lifecycle.finish(run, outcome)
    assert jobs.queue.active.items() == {}
    assert list(jobs.queue.finished.items()) == [run.input]
