import io
import logging
import os
import subprocess
import sys
import time

import pytest

from ciir.errors import QueueUnavailable
from ciir.service.jobs.job import Problem, Request, Result
from ciir.service.jobs.jobs import UNKNOWN_SECONDS
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.recovery import DEAD_SECONDS, STALE_SECONDS, STRAY_SECONDS, Watch, claim_of, owner_of

DIE_HOLDING_A_JOB = """
import os, sys
from pathlib import Path
from ciir.service.jobs.jobs import Jobs
from ciir.service.jobs.jobs import UNKNOWN_SECONDS
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
from ciir.service.jobs.workers.recovery import Watch, claim_of
from ciir.service.settings import Settings
jobs = Jobs(Settings(folder=sys.argv[1]))
owner = ConsumerLock(jobs.folder)
Watch(jobs, owner).beat()
run = jobs.lifecycle.begin(jobs.queue.pop(("small",), 10), claim_of(owner.name, 1))
with jobs.files.run(run.input, run.output) as place:
    place.target.write_bytes(b"half")
    os.kill(os.getpid(), 9)
"""


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def owner(jobs):
    owner = ConsumerLock(jobs.folder)
    yield owner
    owner.close()


@pytest.fixture
def watch(jobs, owner, clock):
    watch = Watch(jobs, owner, clock)
    watch.beat()
    return watch


def hand_in(jobs):
    return jobs.submit(Request("upload.png", {}, None), io.BytesIO(b"data"), size=4)


def begin(jobs, owner="elsewhere", number=1):
    """A run of another machine's consumer, which no lock here tells of."""
    return jobs.lifecycle.begin(jobs.queue.pop(("small", "large"), 0.01), claim_of(owner, number))


def test_claims_tell_whose_they_are():
    assert owner_of(claim_of("0f", 12)) == "0f"


def test_a_consumer_whose_count_stands_still_is_dead(jobs, helpers, watch, clock):
    job = hand_in(jobs)
    jobs.queue.beats.put("elsewhere", b"7")
    run = begin(jobs)
    left = jobs.files.run(run.input, run.output)
    left.__enter__().target.write_bytes(b"half")
    watch.look([])
    clock.now += DEAD_SECONDS - 0.1
    watch.look([])
    assert jobs.get(job.id).state == "running"
    clock.now += 0.2
    watch.look([])
    assert jobs.get(job.id).state == "queued"
    assert jobs.queue.pop(("small",), 0.01) == job.id
    assert jobs.files.runs() == []
    assert "elsewhere" not in jobs.queue.beats.items()


def test_nobody_is_dead_because_the_queue_was_away(jobs, watch, clock, monkeypatch):
    def fail(key, value):
        raise QueueUnavailable("no answer")

    job = hand_in(jobs)
    jobs.queue.beats.put("elsewhere", b"7")
    begin(jobs)
    watch.look([])
    clock.now += DEAD_SECONDS - 0.1
    with monkeypatch.context() as away:
        away.setattr(jobs.queue.beats, "put", fail)
        with pytest.raises(QueueUnavailable):
            watch.beat()
    clock.now += DEAD_SECONDS
    watch.look([])
    assert jobs.get(job.id).state == "running"
    clock.now += DEAD_SECONDS
    watch.look([])
    assert jobs.get(job.id).state == "queued"


def test_a_consumer_that_counts_lives(jobs, helpers, watch, clock):
    job = hand_in(jobs)
    begin(jobs)
    for count in range(5):
        jobs.queue.beats.put("elsewhere", str(count).encode())
        watch.look([])
        clock.now += DEAD_SECONDS - 0.1
    assert jobs.get(job.id).state == "running"


@pytest.mark.parametrize("wall", [-1e9, 0.0, 1e9])
def test_the_clock_on_the_wall_decides_nothing(jobs, watch, clock, monkeypatch, wall):
    job = hand_in(jobs)
    jobs.queue.beats.put("elsewhere", b"7")
    begin(jobs)
    watch.look([])
    monkeypatch.setattr("time.time", lambda: wall)
    watch.look([])
    assert jobs.get(job.id).state == "running"
    clock.now += DEAD_SECONDS
    watch.look([])
    assert jobs.get(job.id).state == "queued"


def test_a_consumer_that_never_counted_is_dead_after_the_same_time(jobs, helpers, watch, clock):
    job = hand_in(jobs)
    begin(jobs)
    watch.look([])
    clock.now += DEAD_SECONDS - 0.1
    watch.look([])
    assert jobs.get(job.id).state == "running"
    clock.now += 0.1
    watch.look([])
    assert jobs.get(job.id).state == "queued"


def test_a_process_of_this_machine_that_was_killed_is_dead_at_once(jobs, helpers, watch):
    job = hand_in(jobs)
    command = [sys.executable, "-c", DIE_HOLDING_A_JOB, str(jobs.folder)]
    assert subprocess.run(command, check=False).returncode == -9  # noqa: S603 - our own
    assert jobs.get(job.id).state == "running"
    assert len(helpers.all_files(jobs.folder)) == 2
    watch.look([])
    watch.tidy()
    assert jobs.get(job.id).state == "queued"
    assert jobs.queue.pop(("small",), 0.01) == job.id
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{job.input}"]
    assert jobs.files.runs() == []
    assert len(list((jobs.folder / "owners").iterdir())) == 1


def test_what_a_dead_process_of_this_machine_left_of_a_run_that_is_no_more_goes_too(jobs, helpers, watch):
    job = hand_in(jobs)
    subprocess.run([sys.executable, "-c", DIE_HOLDING_A_JOB, str(jobs.folder)], check=False)  # noqa: S603 - our own
    jobs.cancel(job.id)
    assert len(jobs.files.runs()) == 1
    watch.look([])
    watch.tidy()
    assert jobs.files.runs() == []


def test_a_job_that_fell_out_of_the_queue_is_put_back_once(jobs, helpers, watch, clock, caplog):
    job = hand_in(jobs)
    assert jobs.queue.pop(("small",), 0.01) == job.id  # and whoever took it died before the claim
    watch.look([])
    clock.now += STRAY_SECONDS - 0.1
    watch.look([])
    assert jobs.queue.contents() == set()
    clock.now += 0.1
    with caplog.at_level(logging.WARNING):
        watch.look([])
    assert job.id in caplog.text
    clock.now += 10 * STRAY_SECONDS
    watch.look([])
    watch.look([])
    assert jobs.waiting() == 1


def test_a_job_that_waits_in_the_queue_is_left_there(jobs, helpers, watch, clock):
    hand_in(jobs)
    for _ in range(3):
        watch.look([])
        clock.now += 1000 * STRAY_SECONDS
    assert jobs.waiting() == 1


def test_a_run_of_this_consumer_that_no_thread_does(jobs, helpers, watch, owner, clock):
    job = hand_in(jobs)
    run = begin(jobs, owner.name)
    for _ in range(3):
        watch.look([run.claim])
        clock.now += 10 * DEAD_SECONDS
    assert jobs.get(job.id).state == "running"
    watch.look([])
    clock.now += STRAY_SECONDS
    watch.look([])
    assert jobs.get(job.id).state == "queued"


@pytest.mark.parametrize("which", ["input without a job", "input of an earlier job"])
def test_an_input_that_belongs_to_nothing_goes_in_the_end(jobs, helpers, watch, clock, which):
    job = hand_in(jobs)
    stray = "0" * 32 + ".1" if which == "input without a job" else job.id + ".1"
    jobs.queue.active.put(stray, b"{}")
    (jobs.folder / "files" / "inputs" / stray).write_bytes(b"x")
    (jobs.folder / "files" / "runs" / f"{stray}.partial").write_bytes(b"x")
    watch.look([])
    clock.now += STALE_SECONDS - 1
    watch.look([])
    assert len(helpers.all_files(jobs.folder)) == 3
    clock.now += 1
    watch.look([])
    assert helpers.all_files(jobs.folder) == [f"files/inputs/{job.input}"]
    assert list(jobs.queue.active.items()) == [job.input]


@pytest.mark.parametrize("is_old", [True, False])
def test_old_files_that_no_job_knows_of_go_at_the_start(jobs, helpers, watch, is_old):
    done, waiting = hand_in(jobs), helpers.submit(jobs, b"waiting")
    run = jobs.lifecycle.begin(done.id, "elsewhere-1")
    with jobs.files.run(run.input, run.output) as place:
        place.target.write_bytes(b"result")
        place.keep()
    assert jobs.lifecycle.finish(run, Result("png", 6, {}))
    known = helpers.all_files(jobs.folder)
    for name in (
        f"results/{done.id}.elsewhere-2",
        "results/ffff.elsewhere-3",
        f"inputs/{waiting.id}.1",
        "inputs/ffff.1",
    ):
        (jobs.folder / "files" / name).write_bytes(b"x")
    if is_old:
        for name in helpers.all_files(jobs.folder):
            os.utime(jobs.folder / name, (0, time.time() - UNKNOWN_SECONDS - 60))
    watch.look([])
    watch.tidy()
    assert len(helpers.all_files(jobs.folder)) == (2 if is_old else 6)
    assert set(known) <= set(helpers.all_files(jobs.folder))
    assert known == sorted([f"files/results/{run.output}", f"files/inputs/{waiting.input}"])


def test_an_end_that_was_left_half_told_is_told(jobs, helpers, watch, monkeypatch):
    run = jobs.lifecycle.begin(hand_in(jobs).id, "elsewhere-1")
    with monkeypatch.context() as patch:
        patch.setattr(jobs.lifecycle, "settle", lambda job: None)  # the process died here
        assert jobs.lifecycle.finish(run, Problem(422, "Title", "detail"))
    assert len(helpers.all_files(jobs.folder)) == 1
    watch.look([])
    assert helpers.all_files(jobs.folder) == []
    assert jobs.queue.active.items() == {}
    assert list(jobs.queue.kept.items()) == [run.input]


def test_two_watchers_run_a_job_again_once(service, jobs, helpers, watch, clock):
    job = hand_in(jobs)
    jobs.queue.beats.put("elsewhere", b"7")
    begin(jobs)
    other_owner = ConsumerLock(jobs.folder)
    other = Watch(service.jobs(), other_owner, clock)
    other.beat()
    for seconds in (0, DEAD_SECONDS):
        clock.now += seconds
        watch.look([])
        other.look([])
    assert jobs.waiting() == 1
    assert [event.kind for event in jobs.get(job.id).events] == ["queued", "running", "queued"]
    other_owner.close()
