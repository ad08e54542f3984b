"""The queue and the tables of jobs, in a SQLite file or on a Redis server, through huey's storages.

Only the storages of huey are used, because its consumer loses the task of a process that is killed. The storages have
no compare and swap, can't wait for two queues, and need a SQLite connection for each queue; this module adds what is
missing. After a power cut a SQLite file may lack the last writes, but never a `synced` one or any before it. A Redis
server with `appendfsync always` lacks none.
"""

from __future__ import annotations

import copy
import re
import sqlite3
import sys
import threading
import time
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from huey.constants import EmptyData
from huey.storage import RedisStorage, SqliteStorage

from ciir.errors import InvalidOption
from ciir.service.jobs.disk import has_room
from ciir.service.jobs.lanes import LANES
from ciir.service.jobs.resource import DISK_FULL, FULL_AT_START, Resource, is_full

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from redis import ConnectionPool
    from redis.client import PubSubWorkerThread

    from ciir.service.jobs.job import Lane

FILE = "jobs.db"
POLL_SECONDS = (0.02, 0.25)
"""Least and most time between two polls of a SQLite file for changes by other processes."""
REDIS_POLL_SECONDS = (1.0, 2.0)
"""The same for a Redis server, whose notifications are lost only if a connection breaks."""
MEMORY_SHARE = 0.75
"""Share of a Redis server's `maxmemory` that jobs may take before ended ones are removed early."""
_CONNECT_SECONDS, _ANSWER_SECONDS = 2.0, 5.0
_LISTEN_SECONDS = 0.25
"""Time that a listening thread takes to stop."""
_JOBS = "ciirjobs"
_REMEDY = (
    f"stop the server and remove {FILE}: accepted jobs are then queued again from what is kept next to their inputs, "
    "and ended jobs are forgotten"
)
_SWAP = """\
if redis.call('hget', KEYS[1], ARGV[1]) ~= ARGV[2] then return 0 end
redis.call('publish', KEYS[1], ARGV[1])
if ARGV[3] then redis.call('hset', KEYS[1], ARGV[1], ARGV[3]) else redis.call('hdel', KEYS[1], ARGV[1]) end
return 1"""


class _Sqlite(SqliteStorage):  # type: ignore[misc]
    """huey's tables in one file, with compare and swap."""

    def _create_connection(self) -> Any:
        connection = super()._create_connection()
        connection.execute(f"pragma synchronous={'full' if self._fsync else 'normal'}")
        return connection

    def with_name(self, name: str) -> _Sqlite:
        self.conn  # noqa: B018 - connects before the copy is made
        other = copy.copy(self)
        other.name = name
        return other

    def swap(self, key: str, old: bytes, new: bytes | None) -> bool:
        with self.db(commit=True) as cursor:
            if new is None:
                cursor.execute("delete from kv where queue=? and key=? and value=?", (self.name, key, old))
            else:
                cursor.execute("update kv set value=? where queue=? and key=? and value=?", (new, self.name, key, old))
            return bool(cursor.rowcount == 1)


class _Redis(RedisStorage):  # type: ignore[misc]
    """huey's keys under one name, with compare and swap."""

    def __init__(self, name: str, pool: ConnectionPool) -> None:
        super().__init__(name, blocking=False, connection_pool=pool)
        self._swap = self.conn.register_script(_SWAP)

    def swap(self, key: str, old: bytes, new: bytes | None) -> bool:
        return bool(self._swap(keys=[self.result_key], args=[key, old, *([] if new is None else [new])]))


def _describe(error: Exception) -> str | None:
    """Returns the message for an error of the storage, without the server's address or path."""
    if is_full(error):
        return DISK_FULL
    redis = sys.modules.get("redis")  # an extra, imported only if a Redis server is used
    if redis is not None and isinstance(error, redis.ResponseError):
        refusal = "refuses commands, as a full one or a replica does; the log has its answer"
        return f"the queue can't be used (its server {refusal}); try again later"
    if redis is not None and isinstance(error, redis.RedisError):
        return "the queue can't be used (its server doesn't answer); try again later"
    if type(error) is sqlite3.DatabaseError:  # damaged; its subclasses are for temporary errors
        return f"the queue can't be used ({error}); its operator must {_REMEDY}"
    return f"the queue can't be used ({error}); try again later" if isinstance(error, sqlite3.Error) else None


class Table:
    """Values by key. Every method raises `QueueUnavailable` if the storage can't be reached or written."""

    def __init__(
        self, storage: _Sqlite | _Redis, reads: Resource, writes: Resource, synced: _Sqlite | _Redis | None = None
    ) -> None:
        """`synced` is the same storage, whose writes are on the disk when they return."""
        self._storage, self._reads, self._writes, self._synced = storage, reads, writes, synced or storage

    def get(self, key: str) -> bytes | None:
        """Returns the value, or None."""
        with self._reads.use():
            value = self._storage.peek_data(key)
        return None if value is EmptyData else bytes(value)

    def get_many(self, keys: Sequence[str]) -> dict[str, bytes]:
        """Returns the values of those keys that have one."""
        if not keys:
            return {}
        with self._reads.use():
            return {key: bytes(value) for key, value in self._storage.peek_many(keys).items()}

    def items(self) -> dict[str, bytes]:
        """Returns all values by key."""
        with self._reads.use():
            return {key: bytes(value) for key, value in self._storage.result_items().items()}

    def put(self, key: str, value: bytes) -> None:
        """Sets the value."""
        with self._writes.use():
            self._storage.put_data(key, value)

    def swap(self, key: str, old: bytes | None, new: bytes | None, *, synced: bool = False) -> bool:
        """Replaces `old` by `new` atomically. Returns False if the value is not `old`. None stands for no value.

        With `synced`, it returns once this and all earlier writes are on the disk.
        """
        storage = self._synced if synced else self._storage
        with self._writes.use():
            if old is None:
                return new is not None and bool(storage.put_if_empty(key, new))
            return storage.swap(key, old, new)

    def remove(self, key: str) -> None:
        """Removes the value, if there is one."""
        with self._writes.use():
            self._storage.delete_data(key)


class Queue:
    """The lanes of waiting ids, and the tables. Threads can share it; each process opens its own."""

    def __init__(self, folder: Path, url: str = "") -> None:
        """`url`: a Redis server, or empty for `FILE` in `folder`. Raises `InvalidOption` if it can't be opened."""
        self._resource = Resource("the queue", _describe)
        self._writes = Resource("writing to the queue", _describe)  # separate, because a full disk can still be read
        self._pool: ConnectionPool | None = None
        self._sqlite: _Sqlite | None = None
        self._synced: _Sqlite | None = None
        if url:
            self._pool = _open_pool(url)
        else:
            try:
                self._sqlite = _Sqlite("ciir", filename=str(folder / FILE))
                self._synced = _Sqlite(_JOBS, filename=str(folder / FILE), fsync=True, create_tables=False)
            except sqlite3.Error as error:
                if is_full(error) or not has_room(folder):  # SQLite calls the latter an I/O error
                    raise InvalidOption(f"{folder}: {FULL_AT_START}") from error
                raise InvalidOption(
                    f"{folder / FILE}: jobs can't be stored there ({error}); name another folder, or {_REMEDY}"
                ) from error
        self._lanes = {lane: self._open(f"ciir{lane}") for lane in LANES}
        self.jobs = Table(self._open(_JOBS), self._resource, self._writes, self._synced)
        """Id -> the job's record."""
        self.active = self._open_table("ciiractive")
        """Name of a job's input -> nothing, from before the input is stored until the job is settled."""
        self.finished = self._open_table("ciirfinished")
        """Name of an ended job's input -> when it was last used (seconds since 1970), and its bytes."""
        self.heartbeats = self._open_table("ciirheartbeats")
        """Name of a consumer -> a count that rises while it lives."""
        self._checks = self._open_table("ciirchecks")
        self.poll_seconds = REDIS_POLL_SECONDS if url else POLL_SECONDS
        """Least and most time between two reads of a job that somebody is waiting for."""
        self._listener: PubSubWorkerThread | None = None
        self._pushed = threading.Condition()
        self._wakes = 0

    def _open(self, name: str) -> _Sqlite | _Redis:
        if self._sqlite is not None:
            return self._sqlite.with_name(name)
        assert self._pool is not None  # noqa: S101 - one of them is set
        return _Redis(name, self._pool)

    def _open_table(self, name: str) -> Table:
        return Table(self._open(name), self._resource, self._writes)

    def push(self, lane: Lane, id_: str) -> None:
        """Appends an id to a lane, which may hold it twice. Raises `QueueUnavailable`."""
        with self._writes.use():
            self._lanes[lane].enqueue(id_.encode())
        self.wake()

    def pop(self, lanes: Sequence[Lane], seconds: float) -> str | None:
        """Removes and returns the first id of the first of `lanes` that has one; None after `seconds`, or after `wake`.

        Raises `QueueUnavailable`.
        """
        if self._pool is not None:
            with self._resource.use():
                conn = self._lanes[lanes[0]].conn
                found = conn.brpop([self._lanes[lane].queue_key for lane in lanes], timeout=seconds)
            return None if found is None else found[1].decode()
        deadline = time.monotonic() + seconds
        pause = POLL_SECONDS[0]
        is_woken = False
        while True:
            wakes = self._wakes
            for lane in lanes:
                with self._resource.use():
                    id_ = self._lanes[lane].dequeue()
                if id_ is not None:
                    return bytes(id_).decode()
            remaining = deadline - time.monotonic()
            if remaining <= 0 or is_woken:
                return None
            with self._pushed:
                is_woken = self._pushed.wait_for(lambda: self._wakes != wakes, min(pause, remaining))  # noqa: B023
            pause = min(2 * pause, POLL_SECONDS[1])

    def listen(self, notify: Callable[[str], object]) -> None:
        """Calls `notify` from now on, in a thread, with the id of each job that any process changes.

        This is only done with a Redis server. Raises `QueueUnavailable`.
        """
        if self._pool is None or self._listener is not None:
            return
        storage = _Redis(_JOBS, self._pool)
        with self._resource.use():
            channel = storage.conn.pubsub(ignore_subscribe_messages=True)
            channel.subscribe(**{storage.result_key: lambda message: notify(message["data"].decode())})
            self._listener = channel.run_in_thread(_LISTEN_SECONDS, daemon=True, exception_handler=_pause)

    def wake(self) -> None:
        """Makes every waiting `pop` in this process check its lanes once more and return."""
        with self._pushed:
            self._wakes += 1
            self._pushed.notify_all()

    def count_waiting(self, lane: Lane) -> int:
        """Counts the ids in a lane. Raises `QueueUnavailable`."""
        with self._resource.use():
            return int(self._lanes[lane].queue_size())

    def list_waiting(self) -> set[str]:
        """Returns all ids in the lanes. Raises `QueueUnavailable`."""
        with self._resource.use():
            return {bytes(id_).decode() for storage in self._lanes.values() for id_ in storage.enqueued_items()}

    def check(self) -> None:
        """Raises `QueueUnavailable` if a Redis server accepts no writes, such as over `maxmemory` or as a replica."""
        if self._pool is not None:
            self._checks.put("writes", b"")

    def is_short_of_memory(self) -> bool:
        """Checks whether a Redis server uses `MEMORY_SHARE` of its `maxmemory`. Raises `QueueUnavailable`."""
        if self._pool is None:
            return False
        with self._resource.use():
            memory = self._lanes[LANES[0]].conn.info("memory")
        return bool(0 < MEMORY_SHARE * memory["maxmemory"] < memory["used_memory"])

    def close(self) -> None:
        """Closes the connections."""
        if self._listener is not None:
            self._listener.stop()
            self._listener.join()
        for storage in (self._sqlite, self._synced):
            if storage is not None:
                storage.close()
        if self._pool is not None:
            self._pool.disconnect()


def _pause(error: BaseException, *_: object) -> None:
    """Makes a listener try again after an error of the server, which all other uses report."""
    if not isinstance(error, Exception) or _describe(error) is None:
        raise error
    time.sleep(_LISTEN_SECONDS)


def _open_pool(url: str) -> ConnectionPool:
    from redis import ConnectionPool, RedisError
    from redis.backoff import NoBackoff
    from redis.retry import Retry

    form = "give one such as redis://localhost:6379/0"
    if not url.startswith("unix:") and re.fullmatch(r"/?\d*", urlsplit(url).path) is None:  # redis would take it as 0
        raise InvalidOption(f"CIIR_QUEUE: its path is not the number of a database; {form}")
    try:
        pool = ConnectionPool.from_url(
            url,
            socket_connect_timeout=_CONNECT_SECONDS,
            socket_timeout=_ANSWER_SECONDS,
            retry=Retry(NoBackoff(), 0),  # a command whose answer was lost must not run twice
        )
        pool.connection_class(**pool.connection_kwargs)  # connects to nothing, but refuses unknown options
    except (ValueError, TypeError, RedisError) as error:  # the message leaves out the URL, which may contain a password
        raise InvalidOption(f"CIIR_QUEUE: not the URL of a Redis server ({error}); {form}") from error
    return pool
