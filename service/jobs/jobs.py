"""The jobs of one queue: submit, look up, wait for, cancel, fetch and expire them."""

from __future__ import annotations

import io
import json
import logging
import math
import secrets
import time
from contextlib import suppress
from dataclasses import asdict
from typing import IO, TYPE_CHECKING, BinaryIO

from ciir.errors import InvalidOption, NoRoom, QueueFull, QueueUnavailable, ResultExpired, TooLarge
from ciir.service.jobs.disk import Disk
from ciir.service.jobs.files import INPUTS, RECORD, RESULTS, Files, hash_content, make_folder
from ciir.service.jobs.identity import compute_file_id, compute_id, hash_installation
from ciir.service.jobs.job import FINAL, KEPT_FILE, Event, Job, Request, Result, parse_id
from ciir.service.jobs.lanes import LANES, choose_lane, estimate_job
from ciir.service.jobs.lifecycle import Lifecycle
from ciir.service.jobs.queue import FILE, Queue
from ciir.service.jobs.records import Records
from ciir.service.jobs.resource import FULL_AT_START, is_full
from ciir.service.jobs.watcher import Watcher
from ciir.service.jobs.workers.task import TaskLimits
from ciir.service.logs import REQUEST_ID

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.service.jobs.job import Lane, State
    from ciir.service.settings import Settings

MIN_KEEP_SECONDS = 60.0
"""Least time that a result is kept after its last use, even over `keep_bytes`, so that a waiting client can fetch
it."""
SWEEP_LIMIT_SECONDS = 2.0
"""Time limit of one sweep: its thread must also send heartbeats, and removing from an object store is slow."""
FINISHED_LIMIT = 50_000
"""Most ended jobs that are kept, whatever their size, because each sweep reads them all."""
JOBS_PER_SECOND = 4
"""Assumed speed of a server for small jobs, to estimate `Retry-After`."""
_log = logging.getLogger("ciir.jobs")


class Jobs:
    """All jobs.

    Threads can share it. Every method raises `QueueUnavailable` if the queue or the files can't be used.
    """

    def __init__(self, settings: Settings) -> None:
        """Opens or creates the queue and the folders that `settings` name. Raises `InvalidOption`."""
        self.folder: Path = settings.find_folder()
        try:
            make_folder(self.folder, 0o700)
        except OSError as error:
            why = FULL_AT_START if is_full(error) else f"not usable for jobs ({error.strerror}); name another folder"
            raise InvalidOption(f"{self.folder}: {why}") from error
        self.files = Files(settings.files or str(self.folder / "files"), self.folder)
        self.queue = Queue(self.folder, settings.queue)
        self.records = Records(self.queue.jobs)
        self.watcher = Watcher(self.records, self.queue)
        self._installation = hash_installation()  # now, because an update may replace the files while this process runs
        self.lifecycle = Lifecycle(self.queue, self.records, self.files, self._installation)
        database = None if settings.queue else self.folder / FILE
        self.disk = Disk((self.folder, self.files.runs), database, settings.max_body_bytes)
        self._max_waiting, self._job_seconds = settings.max_waiting, settings.job_seconds
        self.keep_seconds, self._keep_bytes = settings.keep_seconds, settings.keep_bytes
        self._limits = asdict(TaskLimits.from_settings(settings)) | {"job_seconds": settings.job_seconds}
        """They determine whether a job has a result or a problem."""

    def submit(self, request: Request, file: BinaryIO, client: str = "", content: str = "") -> tuple[Job, bool]:
        """Returns the job for `request` and all bytes of `file`, and whether it is new. A new one has been stored.

        A job that failed because of an error in the input is not run again. A job is run again if it failed otherwise,
        was cancelled, lost its result, or was ended by a worker of another version. `client` is listed in the job.
        `content`: the file's SHA-256, if it is known. Raises `QueueFull` if `max_waiting` jobs wait in its lane
        (simultaneous calls may exceed it a little).
        """
        content = content or hash_content(file)
        id_ = compute_id(request, content, self._limits)
        found = self.records.get(id_)
        if (joined := self._join_stored(found, client)) is not None:
            return joined, False
        self.disk.check()
        lane = choose_lane(request, file)
        waiting = self.queue.count_waiting(lane)
        if waiting >= self._max_waiting:
            one = min(estimate_job(request, file), self._job_seconds)  # a place becomes free when a job like it ends
            pause = max(1 + waiting // JOBS_PER_SECOND, math.ceil(one))
            limit = f"{waiting} jobs wait, and the limit is {self._max_waiting}"
            raise QueueFull(f"the queue is full: {limit}; try again in {pause} s", pause)
        name = f"{id_}.{secrets.token_hex(8)}"
        new = Job(
            id_,
            request,
            created=time.time(),
            clients=(client,),
            lane=lane,
            request_id=REQUEST_ID.get(),
            input=name,
            content=content,
            events=(Event("queued"),),
        )
        self._put_input(new, file)
        created = self.records.update(id_, lambda job: self._join(job, client) or new) or new
        if created.input != name:  # another call submitted the same job in the meantime
            self.remove_input(name)
            return self._mark_used(created), False
        self.queue.push(lane, id_)
        if found is not None and found.made_by not in ("", self._installation):
            _log.warning(
                "job %s: a worker of another installation (version, packages or CIIR_MODELS) had run it; it runs again",
                id_,
            )
        if found is not None and found.result is not None:
            with suppress(QueueUnavailable):  # logged; it is removed as an orphan
                self.files.remove(RESULTS, found.output)
        return created, True

    def keep_file(self, name: str, file: BinaryIO, client: str = "") -> tuple[Job, bool]:
        """Keeps all bytes of `file` as the result of an ended job; returns that job, and whether it is new.

        `client` is listed in the job. Raises `TooLarge` if the file alone exceeds `keep_bytes`, and `NoRoom` if it
        does so with what was used within `MIN_KEEP_SECONDS`.
        """
        content = hash_content(file)
        id_ = compute_file_id(name, content)
        if (joined := self._join_stored(self.records.get(id_), client)) is not None:
            return joined, False
        part, size = secrets.token_hex(8), file.seek(0, io.SEEK_END)
        if size > self._keep_bytes:
            limit = f"the limit of {self._keep_bytes:,} for all files and results that are kept (CIIR_KEEP_BYTES)"
            raise TooLarge(f"file: {size:,} bytes are over {limit}; send the file with each request")
        self.disk.check()
        finished, latest = self.queue.finished.items().values(), time.time() - MIN_KEEP_SECONDS
        if size + sum(size for used, size in map(json.loads, finished) if used > latest) > self._keep_bytes:
            raise NoRoom(
                f"the server keeps at most {self._keep_bytes:,} bytes of files and results, and others are in use; try "
                "again in a minute, or send the file with each request"
            )
        new = Job(
            id_,
            Request(name, {}, None, KEPT_FILE),
            state="done",
            created=time.time(),
            clients=(client,),
            input=f"{id_}.{part}",  # the name of the result too, so that `_expire` finds it without a record
            lease=part,
            result=Result("", size, {}, content),
        )
        self.lifecycle.mark_used(new)  # before the file, so that a process that dies leaves no file that never expires
        try:
            self.files.put(RESULTS, {new.output: file})
        except QueueUnavailable:
            self._expire(new.input)
            raise
        kept = self.records.update(id_, lambda job: self._join(job, client) or new) or new
        if kept.input != new.input:  # another call kept the same file in the meantime
            self._expire(new.input)
        return self._mark_used(kept), kept.input == new.input

    def get(self, id_: str) -> Job | None:
        """Returns the current state of the job, or None if there is no such job."""
        return self.records.get(id_)

    def cancel(self, id_: str, client: str = "") -> Job | None:
        """Cancels the job, or removes one that has ended, and returns it; None if there is no such job.

        Its work stops soon. If other clients have asked for the job too, only `client` is removed from it.
        """
        job = self.records.get(id_)
        if job is None or job.state not in FINAL or job.list_others(client):
            return self.lifecycle.cancel(id_, client)
        self._expire(job.input, client)
        return job

    def open_result(self, id_: str) -> IO[bytes]:
        """Opens the result of a finished job and checks that it is intact; the caller closes it.

        Raises `ResultExpired`.
        """
        return self.open_source(id_)[1]

    def open_source(self, id_: str) -> tuple[Job, BinaryIO]:
        """Returns the finished job too, which may be that of a kept file. Otherwise the same as `open_result`."""
        job = self.records.get(id_)
        if job is not None and self._has_result(job):
            with suppress(FileNotFoundError):
                file = self.files.open(RESULTS, job.output)
                return self._mark_used(job), file
        raise ResultExpired(f"{id_}: there is no result, or it has expired; post the input again")

    def stores_result(self, job: Job) -> bool:
        """Checks whether the result of the finished `job` is stored, but not whether it is damaged."""
        return self.files.exists(RESULTS, job.output)

    def count_waiting(self) -> int:
        """Counts the waiting jobs in both lanes, including some that were cancelled."""
        return sum(self.queue.count_waiting(lane) for lane in LANES)

    def measure_ages(self) -> dict[tuple[Lane, State], list[float]]:
        """Measures the seconds since each queued job was submitted, and since each run started, on all machines."""
        now = time.time()
        ages: dict[tuple[Lane, State], list[float]] = {
            (lane, state): [] for lane in LANES for state in ("queued", "running")
        }
        ids = [parse_id(name) for name in self.queue.active.items()]
        for job in self.records.get_many(ids).values():
            if job.state not in FINAL:
                ages[job.lane, job.state].append(now - (job.created if job.state == "queued" else job.started))
        return ages

    def sweep(self) -> bool:
        """Removes jobs unused for `keep_seconds`, and the least recently used over `keep_bytes` or `FINISHED_LIMIT`.

        The least recently used are also removed while a Redis server is short of memory.
        Returns False if it stopped after `SWEEP_LIMIT_SECONDS` with work left.
        """
        now = time.time()
        finished = sorted((*json.loads(value), name) for name, value in self.queue.finished.items().items())
        count, total = len(finished), sum(size for _, size, _ in finished)
        is_short = self.queue.is_short_of_memory()
        deadline = time.monotonic() + SWEEP_LIMIT_SECONDS
        for used, size, name in finished:
            if time.monotonic() > deadline:
                return False
            age = now - used
            is_over = total > self._keep_bytes or count > FINISHED_LIMIT or is_short
            if age < 0:  # the system clock was set back
                self.lifecycle.store_use(name, size)
            elif age > self.keep_seconds or (is_over and age > MIN_KEEP_SECONDS):
                self._expire(name)
                count, total = count - 1, total - size
                is_short = is_short and self.queue.is_short_of_memory()
        return True

    def remove_input(self, name: str) -> None:
        """Removes an input that belongs to no job."""
        self.files.remove(INPUTS, name, name + RECORD)
        self.queue.active.remove(name)

    def close(self) -> None:
        """Closes the queue."""
        self.queue.close()

    def _is_valid(self, job: Job) -> bool:
        """Checks whether the job can answer a new identical request.

        Its id is for this version; its worker may have another.
        """
        if job.state in ("queued", "running"):
            return True
        if job.made_by != self._installation and job.request.kind != KEPT_FILE:
            return False
        if job.state == "done":
            return self._has_result(job)
        return job.state == "failed" and job.problem is not None and job.problem.status < 500

    def _has_result(self, job: Job) -> bool:
        """Checks whether the result is stored as it was published. A damaged one is removed."""
        if job.result is None:
            return False
        if self.files.matches(RESULTS, job.output, job.result.size, job.result.sha256):
            return True
        if self.files.exists(RESULTS, job.output):
            _log.error(
                "job %s: removed its result, which is damaged; the next identical request makes it again", job.id
            )
            self.files.remove(RESULTS, job.output)
        return False

    def _join(self, job: Job | None, client: str) -> Job | None:
        """Returns the job with `client` listed, or None if it can't answer a new identical request."""
        return job.add_client(client) if job is not None and self._is_valid(job) else None

    def _join_stored(self, found: Job | None, client: str) -> Job | None:
        """Returns the job `found` with `client` listed in its record, or None if it can't answer the request."""
        joined = self._join(found, client)
        if joined is not None and joined is not found:
            with suppress(QueueUnavailable):  # logged; on a full disk the job is still answered
                joined = self.records.update(joined.id, lambda job: self._join(job, client))
        return None if joined is None else self._mark_used(joined)

    def _mark_used(self, job: Job) -> Job:
        if job.state == "done":  # a failure is forgotten after some time, even if it is still requested
            with suppress(QueueUnavailable):  # logged; on a full disk the job expires earlier, but is still answered
                self.lifecycle.mark_used(job)
        return job

    def _put_input(self, job: Job, file: BinaryIO) -> None:
        """Stores the input's name before the file, so that a process that dies leaves no file without an entry."""
        self.queue.active.put(job.input, b"{}")
        try:
            self.files.put(INPUTS, {job.input: file, job.input + RECORD: io.BytesIO(job.to_bytes())})
        except QueueUnavailable:
            self.remove_input(job.input)
            raise

    def _expire(self, name: str, client: str | None = None) -> None:
        """Removes the ended job with the input `name`, unless clients other than `client`, if given, asked for it.

        Its result is removed first, because changing the record needs room on the disk. If there is no such job, `name`
        may be that of a file whose record was not stored.
        """

        def is_expired(job: Job) -> bool:
            return job.input == name and job.state in FINAL

        job = self.records.get(parse_id(name))
        if job is not None and client is not None and job.list_others(client):
            return
        self.files.remove(RESULTS, job.output if job is not None and is_expired(job) else name)
        self.records.remove(parse_id(name), is_expired)
        self.queue.finished.remove(name)
