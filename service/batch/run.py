"""Runs a batch: passes its tasks to Dask, a bounded number at a time, and collects the outcomes."""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from distributed import Client, Future, KilledWorker

from ciir.errors import JobError
from ciir.service.batch import engines
from ciir.service.batch.cuts import Cuts
from ciir.service.batch.task import Outcome
from ciir.service.errors import join_lines

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType
    from typing import Self

    from ciir.service.batch.task import Request, Task

Report = Callable[["Task", "Outcome | None", int], object]
"""Called when a task or a part of one ends, with the outcome of the input, if that has ended, and the number of tasks
that were added.
"""
KILLED = (
    f"{2 * engines.ATTEMPTS} worker processes died while running it, perhaps for lack of memory; give the workers "
    "more, or use a smaller input"
)
IN_FLIGHT = 3
"""Tasks submitted to the scheduler at a time for each thread of the workers."""
LOOK_SECONDS = 5.0
"""Interval at which the number of workers is checked."""


class Batch:
    """A batch on an engine. `start_local` or `connect` opens the engine; leaving the block closes it."""

    def __init__(self, request: Request) -> None:
        self._request = request
        self._stack = ExitStack()
        self._address: str | None = None
        self._client: Client
        self._ended: queue.SimpleQueue[Future[Outcome]] = queue.SimpleQueue()
        self.stopped: list[Task] = []
        """Tasks that were on their way when the batch was interrupted. Their outputs may be there."""

    def start_local(self, workers: int, memory: int | None) -> None:
        """Starts worker processes on this machine with `engines.open_local`."""
        self._client = self._stack.enter_context(engines.open_local(workers, memory))

    def connect(self, address: str) -> None:
        """Connects to a cluster with `engines.connect`."""
        self._address = address
        self._client = engines.connect(address)
        self._stack.callback(self._close)

    def _close(self) -> None:
        self._client.close()  # the current client, which may not be the first

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def run(self, tasks: Sequence[Task], report: Report) -> None:
        """Runs each of `tasks` once, and large ones in parts."""
        waiting, cuts = deque(tasks), Cuts()
        running: dict[Future[Outcome], Task] = {}
        put_off: set[str] = set()
        most, looked = 0, 0.0
        try:
            while waiting or running:
                if not looked or time.monotonic() > looked + LOOK_SECONDS:
                    most, looked = max(most, IN_FLIGHT * self._count_threads()), time.monotonic()
                new = [waiting.popleft() for _ in range(min(len(waiting), most - len(running)))]
                running.update(zip(self._submit(new), new, strict=True))
                ended = [future for future in self._wait() if future in running]  # not those of a lost connection
                outcomes = self._collect(ended)
                if outcomes is None:
                    waiting.extendleft(running.values())
                    running.clear()
                    self._reconnect()
                    continue
                for task, outcome in zip(map(running.pop, ended), outcomes, strict=True):
                    if outcome.error == KILLED and task.out not in put_off:
                        put_off.add(task.out)  # it may have had bad luck: try again after all others
                        waiting.append(task)
                        continue
                    following, last = cuts.follow(task, outcome)
                    waiting.extendleft(reversed(following))
                    report(task, last, len(following))
        except BaseException:
            self.stopped = list(running.values())
            self._client.cancel(list(running), force=True)
            raise

    def _count_threads(self) -> int:
        """Returns how many tasks the workers run at once; at least 1."""
        try:
            found: dict[str, int] = self._client.nthreads()
        except OSError:  # the connection was lost, which `_collect` will notice
            return 1
        return max(1, sum(found.values()))

    def _submit(self, tasks: Sequence[Task]) -> list[Future[Outcome]]:
        if not tasks:
            return []
        futures: list[Future[Outcome]] = self._client.map(  # in one message
            engines.run_on_worker, tasks, request=self._request, pure=False
        )
        for future in futures:
            future.add_done_callback(self._ended.put)
        return futures

    def _wait(self) -> list[Future[Outcome]]:
        """Waits for tasks that have ended: at least one, unless none ends within `LOOK_SECONDS`."""
        ended = []
        with suppress(queue.Empty):
            ended.append(self._ended.get(timeout=LOOK_SECONDS))
            while True:
                ended.append(self._ended.get_nowait())
        return ended

    def _collect(self, ended: Sequence[Future[Outcome]]) -> list[Outcome] | None:
        """Returns the outcome of each task, or None if the connection to the scheduler was lost."""
        if self._client.status == "closed":
            return None
        try:
            if all(future.status == "finished" for future in ended):
                with suppress(KilledWorker):  # the worker that held an outcome died after the task ended
                    return list(self._client.gather(ended))  # in one message
            return [self._collect_one(future) for future in ended]
        except CancelledError:
            return None

    def _collect_one(self, future: Future[Outcome]) -> Outcome:
        try:
            outcome: Outcome = future.result()
        except KilledWorker:
            return Outcome("failed", error=KILLED)
        except CancelledError:
            raise
        except Exception as error:  # noqa: BLE001 - one input must not stop the others
            return Outcome("failed", error=join_lines(f"{type(error).__name__}: {error}"))
        return outcome

    def _reconnect(self) -> None:
        if self._address is None:
            raise JobError("the scheduler of this machine's workers ended; run the same command again to continue")
        self._client.close(timeout=1)
        self._client = engines.connect(self._address, engines.RECONNECT_SECONDS)
