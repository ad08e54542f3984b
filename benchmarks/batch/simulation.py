"""Measures how many workers a scheduler feeds: its own time for each task, with simulated workers.

Simulated workers answer when a task's recorded time has passed. The scheduler is Dask's, in a process of its own, and
the client is that of `ciir batch`; only the workers' work is left out. They register, take tasks, report them as
finished, hand out outcomes and send heartbeats as real ones do.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import random
import time
from dataclasses import dataclass
from pickle import dumps
from typing import TYPE_CHECKING, Any

import dask
import psutil
from distributed import Scheduler, Status
from distributed.batched import BatchedSend
from distributed.comm.core import connect
from distributed.core import Server
from distributed.protocol.serialize import to_serialize
from distributed.versions import get_versions

from ciir.service.batch.engines import SETTINGS
from ciir.service.batch.run import Batch
from ciir.service.batch.task import Outcome, Request, Task
from ciir.service.pipeline.options import Options

if TYPE_CHECKING:
    from collections.abc import Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

HEARTBEAT_SECONDS = 5.0
"""The first interval. With more workers heartbeats become rarer, as with real ones; the scheduler sets the interval."""
METRICS: dict[str, Any] = {
    "task_counts": {},
    "bandwidth": {"total": 1e8, "workers": {}, "types": {}},
    "digests_total_since_heartbeat": {},
    "managed_bytes": 0,
    "spilled_bytes": {"memory": 0, "disk": 0},
    "transfer": {"incoming_bytes": 0, "incoming_count": 0, "incoming_count_total": 0, "outgoing_bytes": 0,
                 "outgoing_count": 0, "outgoing_count_total": 0},
    "event_loop_interval": 0.02,
    "cpu": 100.0,
    "memory": 2**28,
    "time": 0.0,
    "host_net_io": {},
}  # fmt: skip
"""Metrics of a worker's heartbeat."""


@dataclass(frozen=True)
class Result:
    """The result of a simulation."""

    tasks: int
    workers: int
    mean_ms: float
    """Mean length of the tasks."""
    seconds: float
    """Seconds from the first task to the last."""
    scheduler_ms: float
    """Processor time of the scheduler for each task."""
    client_ms: float

    def count_workers(self, task_seconds: float) -> int:
        """Returns how many workers are kept busy with tasks of that length before the scheduler is saturated."""
        return int(1000 * task_seconds / self.scheduler_ms)


def simulate(count: int, workers: int, lengths: Sequence[float]) -> Result:
    """Runs `count` tasks, each of one of `lengths` in seconds at random, on simulated workers."""
    context = multiprocessing.get_context("spawn")
    processes: list[BaseProcess] = []
    try:
        address, scheduler = _start(context, _run_scheduler, (), processes)
        _start(context, _run_workers, (address, workers, list(lengths)), processes)
        tasks = [Task(f"/inputs/array_{number:06d}.png", f"array_{number:06d}") for number in range(count)]
        own = psutil.Process()
        with Batch(Request(Options(), "/outputs")) as batch:
            batch.connect(address)
            used = [sum(psutil.Process(scheduler).cpu_times()[:2]), sum(own.cpu_times()[:2])]
            begun = time.perf_counter()
            batch.run(tasks, lambda *_: None)
            seconds = time.perf_counter() - begun
            spent = [sum(psutil.Process(scheduler).cpu_times()[:2]), sum(own.cpu_times()[:2])]
    finally:
        for process in processes:
            process.kill()
            process.join()
    costs = [1000 * (after - before) / count for before, after in zip(used, spent, strict=True)]
    return Result(count, workers, 1000 * sum(lengths) / len(lengths), seconds, *costs)


def _start(context: Any, target: Any, arguments: tuple[Any, ...], processes: list[BaseProcess]) -> tuple[str, int]:
    """Starts a process; returns what it sends when it is ready, and its id."""
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=target, args=(*arguments, there), daemon=True)
    process.start()
    processes.append(process)
    return here.recv(), process.pid


def _run_scheduler(ready: Connection) -> None:
    async def run() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard=False, dashboard_address="127.0.0.1:0") as scheduler:
            ready.send(scheduler.address)
            await scheduler.finished()

    logging.disable(logging.CRITICAL)
    with dask.config.set(SETTINGS):
        asyncio.run(run())


def _run_workers(address: str, count: int, lengths: list[float], ready: Connection) -> None:
    async def run() -> None:
        chance = random.Random(0)  # noqa: S311 - the same order each time
        workers = [SimulatedWorker(address, number, lengths, chance) for number in range(count)]
        for worker in workers:
            await worker.register()
        ready.send("")
        await asyncio.gather(*(worker.serve() for worker in workers))

    asyncio.run(run())


class SimulatedWorker:
    """A worker of one thread that communicates with the scheduler and waits instead of working."""

    def __init__(self, scheduler: str, number: int, lengths: list[float], chance: random.Random) -> None:
        self._server = Server({"get_data": self.send_outcomes})
        self._scheduler, self._number = scheduler, number
        self._lengths, self._chance = lengths, chance
        self._batched = BatchedSend(interval="2ms")
        self._outcome = to_serialize(Outcome("done", seconds=1.0, views=1, model="field-int8"))
        self._type = dumps(Outcome)

    async def register(self) -> None:
        """Listens, and registers with the scheduler."""
        await self._server.listen("tcp://127.0.0.1:0")
        self._comm = await connect(self._scheduler)
        about = {
            "address": self._server.address,
            "status": Status.running.name,
            "nthreads": 1,
            "name": f"simulated-{self._number}",
            "now": time.time(),
            "resources": {},
            "memory_limit": 2**31,
            "local_directory": "",
            "services": {},
            "nanny": None,
            "pid": 0,
            "versions": get_versions(),
            "metrics": METRICS,
            "extra": {},
            "stimulus_id": "register",
            "server_id": self._server.id,
        }
        await self._comm.write({"op": "register-worker", "reply": False, **about}, serializers=["msgpack"])
        answer = await self._comm.read(deserializers=["msgpack"])
        assert answer["status"] == "OK", answer  # noqa: S101
        self._batched.start(self._comm)

    async def serve(self) -> None:
        """Does what the scheduler sends until it ends."""
        beating = asyncio.create_task(self._beat())
        loop = asyncio.get_running_loop()
        while True:
            for message in await self._comm.read():
                if message["op"] == "compute-task":
                    length = self._chance.choice(self._lengths)
                    loop.call_later(length, self._finish, message["key"], message["run_id"], length)
                elif message["op"] == "close":
                    beating.cancel()
                    return

    def _finish(self, key: str, run_id: int, length: float) -> None:
        stop = time.time()
        self._batched.send(
            {
                "op": "task-finished",
                "status": "OK",
                "key": key,
                "run_id": run_id,
                "nbytes": 300,
                "type": self._type,
                "typename": "ciir.service.batch.task.Outcome",
                "metadata": {},
                "thread": 1,
                "startstops": [{"action": "compute", "start": stop - length, "stop": stop}],
                "stimulus_id": f"task-finished-{stop}",
            }
        )

    async def _beat(self) -> None:
        comm, pause = await connect(self._scheduler), HEARTBEAT_SECONDS
        while True:
            await asyncio.sleep(pause * self._chance.uniform(0.9, 1.1))
            about = {
                "address": self._server.address,
                "now": time.time(),
                "metrics": METRICS,
                "executing": {},
                "extensions": {},
            }
            await comm.write({"op": "heartbeat_worker", "reply": True, **about})
            pause = (await comm.read())["heartbeat-interval"]

    async def send_outcomes(self, comm: Any, keys: Sequence[str], **_: object) -> Status:
        """Answers clients and workers that ask for outcomes."""
        await comm.write({"status": "OK", "data": dict.fromkeys(keys, self._outcome)})
        await comm.read()
        return Status.dont_reply
