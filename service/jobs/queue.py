"""Where jobs wait and what is known of them is kept: huey's storage, a SQLite file by default or a Redis server.

Keys are text and values bytes of JSON; nothing that is read is ever executed. What several processes change is changed
by compare and swap. A SQLite file keeps all that was written when a process is killed at any moment; when the machine
loses power it stays whole and may lose what was written last (`synchronous=NORMAL`). What Redis keeps, its `appendonly`
and `appendfsync` say.
"""

from __future__ import annotations

import sqlite3
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from huey.constants import EmptyData
from huey.storage import RedisStorage, SqliteStorage
from redis import ConnectionPool
from redis.backoff import NoBackoff
from redis.exceptions import RedisError
from redis.retry import Retry

from ciir.errors import InvalidOption, QueueUnavailable
from ciir.service.jobs.error_log import Trouble
from ciir.service.jobs.lanes import LANES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ciir.service.jobs.job import Lane

FILE = "jobs.db"
POLL_SECONDS = (0.02, 0.25)
"""How often a SQLite file is looked at for what another process has put there: first, and at most."""
_CONNECT_SECONDS, _ANSWER_SECONDS = 2.0, 5.0
_SWAP = """\
if redis.call('hget', KEYS[1], ARGV[1]) ~= ARGV[2] then return 0 end
if ARGV[3] then redis.call('hset', KEYS[1], ARGV[1], ARGV[3]) else redis.call('hdel', KEYS[1], ARGV[1]) end
return 1"""


class _Sqlite(SqliteStorage):  # type: ignore[misc]
    """huey's tables under one name, by a connection that those of all names share."""

    def __init__(self, name: str, path: Path, shared: _Sqlite | None = None) -> None:
        self._shared = shared
        super().__init__(name, filename=str(path), create_tables=shared is None)
        if shared is not None:
            self.lock: threading.Lock = shared.lock

    @property
    def conn(self) -> Any:
        return super().conn if self._shared is None else self._shared.conn

    def _create_connection(self) -> Any:
        connection = super()._create_connection()
        connection.execute("pragma synchronous=normal")
        return connection

    def swap(self, key: str, old: bytes, new: bytes | None) -> bool:
        with self.db(commit=True) as cursor:
            if new is None:
                cursor.execute("delete from kv where queue=? and key=? and value=?", (self.name, key, old))
            else:
                cursor.execute("update kv set value=? where queue=? and key=? and value=?", (new, self.name, key, old))
            return bool(cursor.rowcount == 1)


class _Redis(RedisStorage):  # type: ignore[misc]
    """huey's keys under one name."""

    def __init__(self, name: str, pool: ConnectionPool) -> None:
        super().__init__(name, blocking=False, connection_pool=pool)
        self._swap = self.conn.register_script(_SWAP)

    def swap(self, key: str, old: bytes, new: bytes | None) -> bool:
        return bool(self._swap(keys=[self.result_key], args=[key, old, *([] if new is None else [new])]))


class _Telling:
    """Tells callers, and the log, of a storage that can't be reached or written."""

    def __init__(self) -> None:
        self._trouble = Trouble("the queue")

    @contextmanager
    def __call__(self) -> Iterator[None]:
        """Raises `QueueUnavailable` in place of what the storage raises; what callers hear names no server and no
        path."""
        try:
            yield
        except (RedisError, sqlite3.Error) as error:
            self._trouble.begins(str(error))
            is_redis = isinstance(error, RedisError)
            why = "its server doesn't answer" if is_redis else str(error)
            raise QueueUnavailable(f"the queue can't be used ({why}); try again later") from error
        self._trouble.is_over()


class Table:
    """Values by key. Every method raises `QueueUnavailable` where the storage can't be reached or written."""

    def __init__(self, storage: _Sqlite | _Redis, telling: _Telling) -> None:
        self._storage, self._telling = storage, telling

    def get(self, key: str) -> bytes | None:
        """What is there."""
        with self._telling():
            value = self._storage.peek_data(key)
        return None if value is EmptyData else bytes(value)

    def many(self, keys: Sequence[str]) -> dict[str, bytes]:
        """What is there of `keys`."""
        if not keys:
            return {}
        with self._telling():
            return {key: bytes(value) for key, value in self._storage.peek_many(keys).items()}

    def items(self) -> dict[str, bytes]:
        """All."""
        with self._telling():
            return {key: bytes(value) for key, value in self._storage.result_items().items()}

    def put(self, key: str, value: bytes) -> None:
        """Puts `value` there, whatever was."""
        with self._telling():
            self._storage.put_data(key, value)

    def swap(self, key: str, old: bytes | None, new: bytes | None) -> bool:
        """Puts `new` in the place of `old` in one step; False where something else is there. None means nothing."""
        with self._telling():
            if old is None:
                return new is not None and bool(self._storage.put_if_empty(key, new))
            return self._storage.swap(key, old, new)

    def remove(self, key: str) -> None:
        """Removes what is there, if anything is."""
        with self._telling():
            self._storage.delete_data(key)


class Queue:
    """The lanes, in which ids wait, and the tables. Threads may share it; processes each open their own."""

    def __init__(self, folder: Path, url: str = "") -> None:
        """`url`: a Redis server's; empty: `FILE` in `folder`. Raises `InvalidOption` where that can't be opened."""
        self._telling = _Telling()
        self._pool: ConnectionPool | None = None
        self._first: _Sqlite | None = None
        if url:
            self._pool = _pool(url)
        else:
            try:
                self._first = _Sqlite("ciir", folder / FILE)
            except sqlite3.Error as error:
                raise InvalidOption(
                    f"{folder / FILE}: jobs can't be kept there ({error}); name another folder, or remove the file"
                ) from error
        self._lanes = {lane: self._open(f"ciir{lane}") for lane in LANES}
        self.jobs = Table(self._open("ciirjobs"), self._telling)
        """Id -> the job."""
        self.active = Table(self._open("ciiropen"), self._telling)
        """A job's `input` -> nothing, while it waits or runs: what has to be looked after."""
        self.kept = Table(self._open("ciirkept"), self._telling)
        """A finished job's `input` -> when it was last asked for (seconds since 1970), and its bytes."""
        self.beats = Table(self._open("ciirbeats"), self._telling)
        """Consumer -> a count that rises while it lives."""
        self._pushed = threading.Condition()
        self._count = 0

    def _open(self, name: str) -> _Sqlite | _Redis:
        if self._first is not None:
            return _Sqlite(name, self._first.filename, self._first)
        assert self._pool is not None  # noqa: S101 - one of them is there
        return _Redis(name, self._pool)

    def push(self, lane: Lane, id_: str) -> None:
        """Puts an id at the end of a lane; it may stand there twice. Raises `QueueUnavailable`."""
        with self._telling():
            self._lanes[lane].enqueue(id_.encode())
        self.wake()

    def pop(self, lanes: Sequence[Lane], seconds: float) -> str | None:
        """The first id of the first of `lanes` that has one; None where none comes within `seconds`, or after `wake`.

        Raises `QueueUnavailable`.
        """
        if self._pool is not None:
            with self._telling():
                conn = self._lanes[lanes[0]].conn
                found = conn.brpop([self._lanes[lane].queue_key for lane in lanes], timeout=seconds)
            return None if found is None else found[1].decode()
        until = time.monotonic() + seconds
        pause = POLL_SECONDS[0]
        is_woken = False
        while True:
            with self._pushed:
                count = self._count
            for lane in lanes:
                with self._telling():
                    id_ = self._lanes[lane].dequeue()
                if id_ is not None:
                    return bytes(id_).decode()
            left = until - time.monotonic()
            if left <= 0 or is_woken:
                return None
            with self._pushed:
                if self._count == count:
                    self._pushed.wait(min(pause, left))
                is_woken = self._count != count
            pause = min(2 * pause, POLL_SECONDS[1])

    def wake(self) -> None:
        """Has those that wait in this process look again."""
        with self._pushed:
            self._count += 1
            self._pushed.notify_all()

    def waiting(self, lane: Lane) -> int:
        """How many ids are in a lane. Raises `QueueUnavailable`."""
        with self._telling():
            return int(self._lanes[lane].queue_size())

    def contents(self) -> set[str]:
        """All ids that wait. Raises `QueueUnavailable`."""
        with self._telling():
            return {bytes(id_).decode() for storage in self._lanes.values() for id_ in storage.enqueued_items()}

    def close(self) -> None:
        """Closes the connections."""
        if self._first is not None:
            self._first.close()
        if self._pool is not None:
            self._pool.disconnect()


def _pool(url: str) -> ConnectionPool:
    try:
        return ConnectionPool.from_url(
            url,
            socket_connect_timeout=_CONNECT_SECONDS,
            socket_timeout=_ANSWER_SECONDS,
            retry=Retry(NoBackoff(), 0),  # what was done though its answer got lost isn't done twice
        )
    except ValueError as error:  # without the address itself, which may hold a password
        raise InvalidOption(
            f"CIIR_QUEUE: no address of a Redis server ({error}); give one such as redis://localhost:6379/0"
        ) from error
