"""Jobs as those who ask see them: handed in, looked up, waited for, cancelled, fetched, and forgotten in the end."""

from __future__ import annotations

import json
import secrets
import time
from contextlib import suppress
from typing import IO, TYPE_CHECKING, Any, BinaryIO

from anyio import to_thread

from ciir.errors import InvalidOption, QueueFull, QueueUnavailable, ResultExpired
from ciir.service.jobs.files import INPUTS, RESULTS, Files
from ciir.service.jobs.identity import identity
from ciir.service.jobs.job import FINAL, Event, Job, Request
from ciir.service.jobs.lanes import LANES, lane
from ciir.service.jobs.lifecycle import Lifecycle
from ciir.service.jobs.queue import POLL_SECONDS, Queue
from ciir.service.jobs.records import Records

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.service.settings import Settings

LEAST_SECONDS = 60.0
"""A result stays for so long after it was last asked for, or made, however little room there is: so that whoever waits
for it gets it."""
UNKNOWN_SECONDS = 86_400.0
MOST_SWEEP_SECONDS = 2.0
"""Of one sweep: whoever sweeps has to say meanwhile that it lives, and an object store takes its time to remove."""
MOST_KEPT = 50_000
"""Finished jobs that are kept, however small: all of them are looked at in each sweep."""
WAITING_PER_SECOND = 4
"""Jobs that a server is taken to finish each second, for a guess of when to come again."""
_LIMITS = (
    "max_files",
    "max_unpacked_bytes",
    "max_ratio",
    "max_pixels",
    "max_set_bytes",
    "max_triangles",
    "max_views",
    "max_output_pixels",
    "job_seconds",
    "worker_cpu_seconds",
    "worker_memory_bytes",
    "worker_file_bytes",
)
"""Settings that may turn a result into a problem."""


class Jobs:
    """Where jobs are. Threads may share it. Every method raises `QueueUnavailable` where queue or files can't be
    used."""

    def __init__(self, settings: Settings) -> None:
        """Opens the places that `settings` name, and makes what isn't there. Raises `InvalidOption`."""
        self.folder: Path = settings.find_folder()
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise InvalidOption(f"{self.folder}: no folder for jobs ({error.strerror}); name another") from error
        self.files = Files(settings.files or str(self.folder / "files"), self.folder)
        self.queue = Queue(self.folder, settings.queue)
        self.records = Records(self.queue.jobs)
        self.lifecycle = Lifecycle(self.queue, self.records, self.files)
        self._max_waiting = settings.max_waiting
        self._keep_seconds, self._keep_bytes = settings.keep_seconds, settings.keep_bytes
        self._limits: dict[str, Any] = {name: getattr(settings, name) for name in _LIMITS}

    def compute_id(self, request: Request, file: BinaryIO) -> str:
        """The id that the job of this request has, or would have."""
        return identity(request, file, self._limits)

    def submit(self, request: Request, file: BinaryIO, *, size: int) -> Job:
        """The job for `request` of the `size` bytes of `file`: the one that there is, or a new one, kept from here on.

        One that failed by the input's fault stands; one that failed otherwise, that was cancelled, or whose result is
        gone is run again. Raises `QueueFull` where `max_waiting` wait in its lane (some more may, where several are
        handed in at the same moment), and `QueueUnavailable` where it can't be kept.
        """
        id_ = self.compute_id(request, file)
        found = self.records.get(id_)
        if found is not None and self._stands(found):
            return self._asked_again(found)
        its_lane = lane(request, size)
        waiting = self.queue.waiting(its_lane)
        if waiting >= self._max_waiting:
            raise QueueFull(retry_after=1 + waiting // WAITING_PER_SECOND)
        name = f"{id_}.{secrets.token_hex(8)}"
        self._keep_input(name, file)
        new = Job(id_, request, created=time.time(), events=(Event("queued"),), lane=its_lane, input=name)
        made = self.records.change(id_, lambda job: None if job is not None and self._stands(job) else new)
        if made is None:  # the same was handed in meanwhile
            self.forget_input(name)
            now = self.records.get(id_)
            if now is None:
                raise QueueUnavailable("the same was handed in, and forgotten, at the same moment; post it again")
            return self._asked_again(now)
        self.queue.push(its_lane, id_)
        return made

    def get(self, id_: str) -> Job | None:
        """The job as it stands; None where there is none."""
        return self.records.get(id_)

    async def wait_for_change(self, id_: str, seen: int) -> Job:
        """The job, once it has other than `seen` events or is at its end. Raises `LookupError` when it is gone."""
        with self.records.listening(id_) as listener:
            pause = POLL_SECONDS[0]
            job = await to_thread.run_sync(self.get, id_)
            while True:
                if job is None:
                    raise LookupError(id_)
                if len(job.events) != seen or job.state in FINAL:
                    return job
                job = await listener.heard(pause)
                pause = min(1.6 * pause, POLL_SECONDS[1])
                if job is None or len(job.events) <= seen:
                    job = await to_thread.run_sync(self.get, id_)

    def cancel(self, id_: str) -> Job | None:
        """The job, cancelled if it waited or ran, else as it was; None where there is none. Its work stops soon."""
        return self.lifecycle.cancel(id_)

    def open_result(self, id_: str) -> IO[bytes]:
        """The result of a job that is done, at its beginning, the caller's to close. Raises `ResultExpired`."""
        job = self.records.get(id_)
        if job is not None and job.result is not None:
            try:
                file = self.files.open(RESULTS, job.output)
            except FileNotFoundError:
                pass
            else:
                self.lifecycle.touch(job)
                return file
        raise ResultExpired(f"{id_}: no result is kept, or no longer; post the input again")

    def waiting(self) -> int:
        """How many wait, in both lanes; some of them may have been cancelled."""
        return sum(self.queue.waiting(each) for each in LANES)

    def running(self) -> int:
        """How many run, on all machines."""
        ids = [name.partition(".")[0] for name in self.queue.active.items()]
        return sum(job.state == "running" for job in self.records.many(ids).values())

    def sweep(self) -> bool:
        """Forgets jobs that were not asked for in `keep_seconds`, and the longest unused of more than `keep_bytes`, or
        `MOST_KEPT`. False where it stopped after `MOST_SWEEP_SECONDS` with some of that left to do.

        Goes by the clock on the wall: where that was set back, what was used in its future counts as used now.
        """
        now = time.time()
        kept = sorted((*json.loads(held), name) for name, held in self.queue.kept.items().items())
        count, total = len(kept), sum(size for _, size, _ in kept)
        until = time.monotonic() + MOST_SWEEP_SECONDS
        for used, size, name in kept:
            if time.monotonic() > until:
                return False
            age = now - used
            is_over = total > self._keep_bytes or count > MOST_KEPT
            if age < 0:
                self.lifecycle.keep(name, size)
            elif age > self._keep_seconds or (is_over and age > LEAST_SECONDS):
                self._forget(name)
                count, total = count - 1, total - size
        return True

    def forget_unknown(self) -> None:
        """Removes files that no job knows of, as where the queue was emptied. Only when they are older than what is
        kept, and than `UNKNOWN_SECONDS`: another queue's server may have been given the same place by mistake.
        """
        results = self.files.names(RESULTS)  # a file is noted before it is made, and until it is removed
        jobs = self.records.many([name.partition(".")[0] for name in results])
        outputs = {job.output for job in jobs.values()}
        inputs = self.files.names(INPUTS)
        unknown = [(RESULTS, name) for name in results if name not in outputs]
        unknown += [(INPUTS, name) for name in set(inputs) - set(self.queue.active.items())]
        for folder, name in unknown:
            with suppress(FileNotFoundError):
                if self.files.age(folder, name) > max(self._keep_seconds, UNKNOWN_SECONDS):
                    self.files.remove(folder, name)

    def close(self) -> None:
        """Closes the queue."""
        self.queue.close()

    def _stands(self, job: Job) -> bool:
        """Whether asking for it again is the same as having asked before."""
        if job.state == "done":
            return self.files.exists(RESULTS, job.output)
        if job.state == "failed":
            return job.problem is not None and job.problem.status < 500
        return job.state in ("queued", "running")

    def _asked_again(self, job: Job) -> Job:
        if job.state in FINAL:
            self.lifecycle.touch(job)
        return job

    def _keep_input(self, name: str, file: BinaryIO) -> None:
        """Notes the input before it is written, so that no process that dies leaves one that nobody knows of."""
        self.queue.active.put(name, b"{}")
        try:
            self.files.put(INPUTS, name, file)
        except QueueUnavailable:
            self.forget_input(name)
            raise

    def forget_input(self, name: str) -> None:
        """Removes an input that belongs to no job."""
        self.files.remove(INPUTS, name)
        self.queue.active.remove(name)

    def _forget(self, name: str) -> None:
        """Removes the finished job whose input had `name`, its result last, so that no job promises what is gone."""
        id_ = name.partition(".")[0]
        job = self.records.remove(id_, lambda job: job.input == name and job.state in FINAL)
        if job is not None:
            self.files.remove(RESULTS, job.output)
        self.queue.kept.remove(name)
