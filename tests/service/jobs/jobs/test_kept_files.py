"""Files that are kept for several requests, as ended jobs without a run."""

import io
import os
import time

import pytest

from ciir.errors import NoRoom, QueueUnavailable, ResultExpired, TooLarge
from ciir.service.jobs.job import KEPT_FILE, Request
from ciir.service.jobs.workers.orphans import ORPHAN_SECONDS, remove_orphaned_files
from tests.support.jobs import finish_job, list_files, read_result, run_in_threads, set_clock, submit_data

NAME = "upload.png"


def keep(jobs, data=b"data", client="", name=NAME):
    return jobs.keep_file(name, io.BytesIO(data), client)


@pytest.fixture(params=["folder", "store"])
def places(request, tmp_path):
    """Settings of a place for files."""
    return {"files": f"memory://{tmp_path.name}/files"} if request.param == "store" else {}


@pytest.fixture
def kept_jobs(service, places):
    return service.open_jobs(**places)


def test_a_kept_file(kept_jobs, service, places):
    job, is_new = keep(kept_jobs)
    assert is_new
    assert (job.state, job.request, job.result.size) == ("done", Request(NAME, {}, None, KEPT_FILE), 4)
    assert kept_jobs.files.list_names("results") == [job.output]
    assert list(kept_jobs.queue.finished.items()) == [job.input]
    assert kept_jobs.count_waiting() == 0
    other = service.open_jobs(**places)  # another server
    again, is_new = keep(other)
    assert (again, is_new) == (job, False)
    found, file = other.open_source(job.id)
    with file:
        assert (found, file.read()) == (job, b"data")
    assert keep(kept_jobs, b"other")[0].id != job.id != keep(kept_jobs, name="upload.tif")[0].id


def test_it_stays_the_same_file_after_an_update(jobs):
    job, _ = keep(jobs)
    jobs._installation = "another"
    assert keep(jobs) == (job, False)


def test_the_queue_on_redis(service, redis_server):
    one, other = (service.open_jobs(queue=redis_server.url) for _ in range(2))
    job, _ = keep(one, client="a")
    assert keep(other, client="b") == (other.get(job.id), False)
    one.cancel(job.id, "a")
    assert read_result(other, job.id) == b"data"
    one.cancel(job.id, "b")
    assert other.get(job.id) is None
    assert list_files(one) == []


def test_the_same_file_at_the_same_time(kept_jobs):
    found = []
    run_in_threads(lambda: found.append(keep(kept_jobs)), 8)
    assert len({job.id for job, _ in found}) == 1
    assert sum(is_new for _, is_new in found) == 1
    job = kept_jobs.get(found[0][0].id)
    assert kept_jobs.files.list_names("results") == [job.output]
    assert list(kept_jobs.queue.finished.items()) == [job.input]


def test_it_expires_after_its_last_use(service, places, monkeypatch):
    jobs = service.open_jobs(keep_seconds=100, **places)
    set_clock(monkeypatch, 1000.0)
    sent, used, left = (keep(jobs, bytes([number]))[0] for number in range(3))
    set_clock(monkeypatch, 1080.0)
    keep(jobs, bytes([0]))
    jobs.open_source(used.id)[1].close()
    set_clock(monkeypatch, 1150.0)
    jobs.sweep()
    assert [jobs.get(job.id) is not None for job in (sent, used, left)] == [True, True, False]
    set_clock(monkeypatch, 1200.0)
    jobs.sweep()
    assert jobs.files.list_names("results") == []
    assert jobs.queue.finished.items() == {}
    with pytest.raises(ResultExpired):
        jobs.open_source(sent.id)


def test_its_bytes_count_with_those_of_results(service, monkeypatch):
    jobs = service.open_jobs(keep_bytes=3000)
    set_clock(monkeypatch, 1000.0)
    first, _ = keep(jobs, bytes(2000))
    set_clock(monkeypatch, 1001.0)
    second = finish_job(jobs, submit_data(jobs), bytes(2000))
    set_clock(monkeypatch, 1100.0)
    jobs.sweep()
    assert (jobs.get(first.id), jobs.get(second.id)) == (None, second)


@pytest.mark.parametrize("step", ["in the file", "before the record", "before the last use"])
def test_a_process_that_dies_leaves_nothing_that_stays(service, places, monkeypatch, step):
    jobs = service.open_jobs(keep_seconds=100, **places)

    def die(*args, **options):
        raise SystemExit

    def die_in_the_file(folder, files):
        ((name, _),) = files.items()
        if not places:
            (jobs.files.runs / f"{name}.partial").write_bytes(b"da")
        raise SystemExit

    with monkeypatch.context() as patch:
        owner, name = {"in the file": (jobs.files, "put"), "before the record": (jobs.records, "update")}.get(
            step, (jobs, "_mark_used")
        )
        patch.setattr(owner, name, die_in_the_file if step == "in the file" else die)
        with pytest.raises(SystemExit):
            keep(jobs)
    later = time.time() + 101
    set_clock(monkeypatch, later)
    jobs.sweep()
    assert jobs.queue.finished.items() == {}
    assert jobs.queue.jobs.items() == {}
    assert list_files(jobs) == [] == jobs.files.list_names("results")
    job, is_new = keep(jobs)
    assert is_new
    assert read_result(jobs, job.id) == b"data"


def test_a_lost_queue_before_the_record(jobs, monkeypatch):
    def fail(*args):
        raise QueueUnavailable("the queue can't be used")

    with monkeypatch.context() as patch:
        patch.setattr(jobs.records, "update", fail)
        with pytest.raises(QueueUnavailable):
            keep(jobs)
    assert keep(jobs)[1]
    assert len(list_files(jobs)) == 2  # the first one expires


def test_a_full_disk(jobs, monkeypatch):
    def refuse():
        raise NoRoom("the server's disk is full")

    job, _ = keep(jobs)
    monkeypatch.setattr(jobs.disk, "check", refuse)
    with pytest.raises(NoRoom):
        keep(jobs, b"other")
    assert keep(jobs) == (job, False)
    assert list(jobs.queue.finished.items()) == [job.input]


def test_a_damaged_one_is_kept_again(jobs):
    job, _ = keep(jobs)
    (jobs.folder / "files" / "results" / job.output).write_bytes(b"dat")
    with pytest.raises(ResultExpired):
        jobs.open_source(job.id)
    again, is_new = keep(jobs)
    assert (again.id, is_new) == (job.id, True)
    assert read_result(jobs, job.id) == b"data"
    assert list_files(jobs) == [f"results/{again.output}"]


def test_it_is_no_orphan(jobs):
    job, _ = keep(jobs)
    path = jobs.folder / "files" / "results" / job.output
    os.utime(path, (0, time.time() - ORPHAN_SECONDS - 60))
    remove_orphaned_files(jobs)
    assert read_result(jobs, job.id) == b"data"


def test_a_job_has_its_own_copy(jobs):
    kept, _ = keep(jobs, client="a")
    found, file = jobs.open_source(kept.id)
    with file:
        job, _ = jobs.submit(Request(NAME, {}, None), file, "a", found.result.sha256)
    assert job.id == submit_data(jobs).id
    jobs.cancel(kept.id, "a")
    assert list_files(jobs) == [f"inputs/{job.input}"]
    with jobs.files.open("inputs", job.input) as own:
        assert own.read() == b"data"


def test_a_file_that_cannot_be_stored_leaves_nothing(jobs, monkeypatch):
    def refuse(*_):
        raise NoRoom("full")

    monkeypatch.setattr(jobs.files, "put", refuse)
    with pytest.raises(NoRoom, match="full"):
        keep(jobs)
    assert not list(jobs.queue.finished.items())
    assert list_files(jobs) == []


def test_files_in_use_keep_within_the_limit(service, monkeypatch):
    jobs = service.open_jobs(keep_bytes=3000)
    set_clock(monkeypatch, 1000.0)
    first, _ = keep(jobs, bytes(1500))
    with pytest.raises(NoRoom, match="keeps at most 3,000 bytes of files and results"):
        keep(jobs, bytes(1501))
    with pytest.raises(TooLarge, match=r"3,001 bytes are over the limit of 3,000 .*; send the file with each request"):
        keep(jobs, bytes(3001))
    set_clock(monkeypatch, 1061.0)
    assert keep(jobs, bytes(1501))[1]  # the first can expire now
    jobs.sweep()
    assert jobs.get(first.id) is None
