"""Jobs whose service is killed meanwhile: none may be lost, and each result is written once.

    python -m tests.load.kills [--jobs 400] [--kills 300] [--queue sqlite redis] [--seconds 900] [--seed 1] [--folder F]

For each queue: starts `ciir serve` with SQLite; or a web process, `ciir worker` and Redis. Clients post small jobs
(`tests.load.requests`), again where the connection breaks or the answer is 503, and wait for each to end. Meanwhile
processes get SIGKILL at random: the web process, the parent of the worker processes, one of these, Redis. Each is
started again at once, as by a service manager. After `--seconds` no more are killed.

Every job must end as done, with the pictures that the command line makes, and its result must not be written again.
Each bound's line ends with whether it holds; exit status 1 where one does not.
"""

from __future__ import annotations

import argparse
import collections
import hashlib
import http.client
import itertools
import json
import random
import socket
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.load.requests import BOUNDARY, PATH, find_origin, make_form, make_request
from tests.load.run import Line, compare_answers, get_exit_status, print_lines
from tests.load.services import TARGETS, Services

if TYPE_CHECKING:
    from collections.abc import Iterator

CLIENTS = 8
ANSWER_SECONDS, RETRY_SECONDS = 60.0, 0.1
MOST_PAUSE_SECONDS = 0.5
"""Before a kill, so that it meets jobs in all stages."""
LATER_SECONDS = 120.0
"""A job without an end so long after `--seconds` is lost."""


@dataclass(frozen=True)
class Outcome:
    """A job when it was done."""

    id: str
    attempts: int
    sha256: str
    """Of the result."""
    files: dict[str, tuple[int, int]]
    """Inode and time of each of its files among the results, by name."""


class Clients:
    """Post the jobs and wait for their ends."""

    def __init__(self, port: int, folder: Path, jobs: int, end: float) -> None:
        self._port, self._folder, self._end = port, folder, end
        kinds = [find_origin(number) for number in range(3 * jobs)]
        self._numbers = [n for n, (kind, first) in enumerate(kinds) if kind in {"small", "mesh"} and first == n][:jobs]
        self._lock = threading.Lock()
        self.accepted = 0
        self.allowed = CLIENTS
        """How many may be posted by now."""
        self.outcomes: dict[int, Outcome] = {}
        self.errors: list[str] = []
        """A line for each job without an outcome."""
        self.answers: collections.Counter[str] = collections.Counter()

    def run(self) -> None:
        """Returns when all jobs have ended."""
        with ThreadPoolExecutor(CLIENTS) as pool:
            list(pool.map(self._run_job, range(len(self._numbers))))

    def _run_job(self, index: int) -> None:
        while index >= self.allowed and time.monotonic() < self._end:
            time.sleep(RETRY_SECONDS)
        number = self._numbers[index]
        try:
            self.store_outcome(number, *self._finish_job(number))
        except Exception as error:  # noqa: BLE001 - reported
            self.errors.append(f"request {number}: {error!r}")

    def _finish_job(self, number: int) -> tuple[str, int]:
        """The id of the job for a request, and its runs, when it is done."""
        form, id_ = make_form(make_request(number)), ""
        while True:
            headers, _ = self._ask("POST", PATH, form, waits=number % 2 == 0)
            with self._lock:
                self.accepted += not id_
            id_ = headers["X-Reconstruction-Id"]
            while (job := json.loads(self._ask("GET", f"{PATH}/{id_}")[1]))["state"] in {"queued", "running"}:
                time.sleep(RETRY_SECONDS)
            if job["state"] == "done":
                return id_, job["attempts"]
            if job["state"] != "failed" or job["problem"]["status"] != 503:
                raise ValueError(f"{id_} ended as {job['state']}: {job['problem']}")
            self.answers[f"failed with 503 {job['problem']['title']}"] += 1  # declared: to be posted again

    def store_outcome(self, number: int, id_: str, attempts: int) -> None:
        """Keeps the result of a job that is done, and what `list_changes` compares."""
        _, body = self._ask("GET", f"{PATH}/{id_}/result")
        (self._folder / "answers" / f"{number}-200").write_bytes(body)
        self.outcomes[number] = Outcome(id_, attempts, hashlib.sha256(body).hexdigest(), self._list_files(id_))

    def _list_files(self, id_: str) -> dict[str, tuple[int, int]]:
        found = {}
        for path in (self._folder / "service" / "files" / "results").glob(f"{id_}.*"):
            with suppress(FileNotFoundError):  # of a run that died, removed just now
                found[path.name] = path.stat().st_ino, path.stat().st_mtime_ns
        return found

    def _ask(self, method: str, path: str, body: bytes | None = None, *, waits: bool = False) -> tuple[Any, bytes]:
        """Headers and body of the first answer that is not 503; raises `ValueError` if that is not 200 or 202."""
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"} if body else {}
        headers |= {} if waits else {"Prefer": "respond-async"}
        while time.monotonic() < self._end + LATER_SECONDS:
            connection = http.client.HTTPConnection("127.0.0.1", self._port, timeout=ANSWER_SECONDS)
            try:
                connection.request(method, path, body, headers)
                answer = connection.getresponse()
                content = answer.read()
            except (OSError, http.client.HTTPException):
                self.answers["no answer"] += 1
            else:
                self.answers[str(answer.status)] += 1
                if answer.status in {200, 202}:
                    return answer.headers, content
                if answer.status != 503 or "Retry-After" not in answer.headers:
                    raise ValueError(f"{method} {path} is answered with {answer.status}: {content[:300]!r}")
            finally:
                connection.close()
            time.sleep(RETRY_SECONDS)
        raise TimeoutError(f"{method} {path} has no answer")

    def list_changes(self) -> Iterator[str]:
        """A line for each job that was done again, or whose result is another one now."""
        for number, outcome in self.outcomes.items():
            _, body = self._ask("GET", f"{PATH}/{outcome.id}/result")
            _, events = self._ask("GET", f"{PATH}/{outcome.id}/events")
            files = self._list_files(outcome.id)
            if hashlib.sha256(body).hexdigest() != outcome.sha256 or events.count(b"event: done") != 1:
                yield f"request {number}: another result, or done more than once: {events.decode()}"
            if not files or not files.items() <= outcome.files.items():
                yield f"request {number}: its file was {outcome.files}, and is {files}"


def measure_kills(queue: str, folder: Path, *, jobs: int, kills: int, seconds: float, seed: int) -> Iterator[Line]:
    """The kills and what came of them; `folder` gets answers, logs and the service's files."""
    (folder / "answers").mkdir(parents=True)
    chance = random.Random(seed)  # noqa: S311 - the same each time is the point
    left = [chance.choice(TARGETS[queue]) for _ in range(kills)]
    killed: collections.Counter[str] = collections.Counter()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    begun = time.monotonic()
    end = begun + seconds
    clients = Clients(port, folder, jobs, end)
    with ExitStack() as stack:
        services = Services(queue, folder, port)
        stack.callback(services.close)
        thread = threading.Thread(target=clients.run)
        thread.start()
        while thread.is_alive() or (left and time.monotonic() < end):
            for process in services.processes.values():
                process.restart_if_ended()
            clients.allowed = CLIENTS + jobs * killed.total() // kills
            if left and time.monotonic() < end and clients.accepted >= jobs * killed.total() // kills:
                time.sleep(chance.uniform(0, MOST_PAUSE_SECONDS))
                if services.kill(left[-1], chance):
                    killed[left.pop()] += 1
            time.sleep(RETRY_SECONDS)
        took = time.monotonic() - begun
        changes = [*clients.errors, *clients.list_changes()]
    done = len(clients.outcomes)
    yield Line(f"{queue}: {killed.total()} of {kills} kills in {took:.0f} s: {_format(killed)}", not left)
    yield Line(f"  answers: {_format(clients.answers)}")
    yield Line(f"  runs of a job: {_format(collections.Counter(each.attempts for each in clients.outcomes.values()))}")
    yield Line(f"  {done} of {jobs} jobs done, {clients.accepted} accepted", done == jobs == clients.accepted)
    yield Line(f"  {len(changes)} lost, answered with an error, or written again", not changes)
    for line in changes[:20]:
        yield Line(f"    {line}")
    failures = {name: process.failures for name, process in services.processes.items() if process.failures}
    yield Line(f"  processes that ended by themselves: {failures or 'none'}", not failures)
    tracebacks = sum(path.read_text(errors="replace").count("Traceback") for path in folder.glob("*.log"))
    yield Line(f"  tracebacks in the logs: {tracebacks}", tracebacks == 0)
    yield from compare_answers(folder, processes=2)


def _format(counts: collections.Counter[Any]) -> str:
    return ", ".join(f"{key}: {count:,}" for key, count in sorted(counts.items()))


def main() -> int:
    """Prints the lines."""
    parser = argparse.ArgumentParser(prog="tests.load.kills", description=main.__doc__)
    parser.add_argument("--jobs", type=int, default=400, help="for each queue (default 400)")
    parser.add_argument("--kills", type=int, default=300, help="for each queue (default 300)")
    parser.add_argument("--queue", nargs="+", choices=TARGETS, default=[*TARGETS], help="default: both")
    parser.add_argument("--seconds", type=float, default=900, help="after which none is killed (default 900)")
    parser.add_argument("--seed", type=int, default=1, help="of what is killed, and of the pauses (default 1)")
    parser.add_argument("--folder", type=Path, help="a new folder to keep logs and files; default: a temporary one")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ciir-kills-") as name:
        options = {name: getattr(given, name) for name in ("jobs", "kills", "seconds", "seed")}
        runs = (measure_kills(queue, (given.folder or Path(name)) / queue, **options) for queue in given.queue)
        return get_exit_status(print_lines(itertools.chain.from_iterable(runs)))


if __name__ == "__main__":
    sys.exit(main())
