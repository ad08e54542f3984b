import json
import threading

import pytest

from ciir.errors import InvalidOption, NoRoom, QueueUnavailable
from ciir.service.jobs import queue as module
from ciir.service.jobs.queue import FILE, Queue
from ciir.service.jobs.resource import DISK_FULL
from tests.support.jobs import run_in_threads
from tests.support.waiting import wait_until


def test_ids_leave_in_order_from_the_first_lane_that_has_one(queue):
    for lane, id_ in [("large", "a"), ("small", "b"), ("large", "c"), ("small", "d")]:
        queue.push(lane, id_)
    assert queue.list_waiting() == {"a", "b", "c", "d"}
    assert (queue.count_waiting("small"), queue.count_waiting("large")) == (2, 2)
    assert [queue.pop(("small", "large"), 0.01) for _ in range(4)] == ["b", "d", "a", "c"]
    assert queue.pop(("small", "large"), 0.01) is None


def pop_during(queue, act):
    """The id that `pop`, waiting in a thread, returns after `act(thread)`."""
    found = []
    thread = threading.Thread(target=lambda: found.append(queue.pop(("small",), 60)))
    thread.start()
    act(thread)
    thread.join(30)
    return found[0]


def test_push_ends_a_wait(queue):
    assert pop_during(queue, lambda _: queue.push("small", "a")) == "a"


def test_push_and_wake_end_a_wait_in_this_process_without_a_poll(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "POLL_SECONDS", (60.0, 60.0))
    queue = Queue(tmp_path)
    assert pop_during(queue, lambda _: queue.push("small", "a")) == "a"
    assert pop_during(queue, lambda thread: wait_until(lambda: queue.wake() or not thread.is_alive())) is None
    queue.close()


def test_push_through_another_connection_ends_a_wait(queue, queue_url, tmp_path):
    other = Queue(tmp_path, queue_url)
    assert pop_during(queue, lambda _: other.push("small", "a")) == "a"
    other.close()


def test_each_id_is_taken_once(queue):
    for number in range(60):
        queue.push("small", str(number))
    taken = []

    def take():
        while (id_ := queue.pop(("small",), 0.01)) is not None:
            taken.append(id_)

    run_in_threads(take, 4)
    assert sorted(taken, key=int) == [str(number) for number in range(60)]


def test_compare_and_swap(queue):
    table = queue.jobs
    assert table.swap("a", None, b"1")
    assert not table.swap("a", None, b"2")
    assert not table.swap("a", b"0", b"2")
    assert table.swap("a", b"1", b"2")
    assert table.get("a") == b"2"
    assert not table.swap("a", b"1", None)
    assert table.swap("a", b"2", None)
    assert table.get("a") is None
    assert not table.swap("a", b"2", b"3")


def test_no_swap_is_lost_among_simultaneous_ones(queue, queue_url, tmp_path):
    other = Queue(tmp_path, queue_url)

    def count():
        for table in (queue.jobs, other.jobs) * 10:
            while True:
                before = table.get("n")
                if table.swap("n", before, json.dumps(json.loads(before or b"0") + 1).encode()):
                    break

    run_in_threads(count, 4)
    assert queue.jobs.get("n") == b"80"
    other.close()


def test_tables_are_separate(queue):
    queue.jobs.put("a", b"1")
    queue.finished.put("a", b"2")
    queue.finished.put("b", b"3")
    assert queue.jobs.items() == {"a": b"1"}
    assert queue.finished.items() == {"a": b"2", "b": b"3"}
    assert queue.finished.get_many(["a", "b", "c"]) == {"a": b"2", "b": b"3"}
    assert queue.finished.get_many([]) == {}
    queue.finished.remove("a")
    queue.finished.remove("a")
    assert queue.finished.items() == {"b": b"3"}


def test_ids_and_values_survive_a_restart(queue, queue_url, tmp_path):
    queue.push("large", "a")
    queue.jobs.put("a", b"1")
    queue.close()
    again = Queue(tmp_path, queue_url)
    assert again.pop(("large",), 0.01) == "a"
    assert again.jobs.get("a") == b"1"
    again.close()


@pytest.mark.parametrize(
    "url",
    [
        "redis://user:secret@host:port/0",
        "http://user:secret@host/0",
        "redis://user:secret@host/0?foo=bar",
        "redis://user:secret@host/zero",
        "redis://user:secret@host/0/secret",
        "redis://user:sec/secret@host/0",
        "rediss://user:secret@host/0?ssl_cert_reqs=any",
    ],
)
def test_an_invalid_url(url, tmp_path):
    with pytest.raises(InvalidOption, match=r"CIIR_QUEUE.*redis://localhost:6379/0") as raised:
        Queue(tmp_path, url)
    assert "secret" not in str(raised.value)


@pytest.mark.parametrize(
    "url", ["redis://host", "rediss://:a%2Fb@host:1/", "unix:///a/b?db=2", "redis://[::1]/15?socket_timeout=1"]
)
def test_a_valid_url_connects_to_nothing_yet(url, tmp_path):
    Queue(tmp_path, url).close()


@pytest.mark.parametrize("command", [("config", "set", "maxmemory", "1"), ("replicaof", "127.0.0.1", "1")])
def test_a_redis_server_that_refuses_writes_is_reported(redis_server, tmp_path, command):
    queue = Queue(tmp_path, redis_server.url)
    queue.check()
    redis_server.call(*command)
    for write in (queue.check, lambda: queue.push("small", "a"), lambda: queue.jobs.swap("a", None, b"1")):
        with pytest.raises(QueueUnavailable, match="its server refuses commands, as a full one or a replica"):
            write()
    assert queue.count_waiting("small") == 0
    redis_server.kill()
    with pytest.raises(QueueUnavailable, match="doesn't answer"):
        queue.check()
    queue.close()


def test_a_redis_server_is_short_of_memory_before_it_refuses_writes(redis_server, tmp_path):
    queue = Queue(tmp_path, redis_server.url)
    used = redis_server.call("info", "memory").split("used_memory:")[1].split()[0]
    for most, expected in ((0, False), (2 * int(used), False), (int(1.2 * int(used)), True)):
        redis_server.call("config", "set", "maxmemory", str(most))
        queue.check()
        assert queue.is_short_of_memory() is expected
    queue.close()
    assert Queue(tmp_path).is_short_of_memory() is False


def test_a_full_disk_is_reported(tmp_path):
    queue = Queue(tmp_path)
    queue.jobs.put("a", b"1")
    connection = queue._sqlite.conn
    (pages,) = connection.execute("pragma page_count").fetchone()
    connection.execute(f"pragma max_page_count={pages}")  # SQLite's error is then that of a full disk
    with pytest.raises(NoRoom, match=DISK_FULL):
        queue.jobs.put("b", bytes(100_000))
    assert queue.jobs.items() == {"a": b"1"}
    connection.execute("pragma max_page_count=1000000")
    queue.jobs.put("b", bytes(100_000))
    queue.close()


def test_a_damaged_file_is_reported_with_the_remedy(tmp_path):
    queue = Queue(tmp_path)
    for number in range(100):
        queue.jobs.put(str(number), bytes(1000))
    queue.close()
    with (tmp_path / FILE).open("r+b") as file:
        file.seek(4096)
        file.write(b"x" * 40960)
    queue = Queue(tmp_path)
    with pytest.raises(QueueUnavailable, match=rf"malformed.*remove {FILE}: accepted jobs are then queued again"):
        queue.jobs.items()
    queue.close()


def test_a_file_that_is_no_database(tmp_path):
    (tmp_path / FILE).write_bytes(b"no database" * 1000)
    with pytest.raises(InvalidOption, match=f"{FILE}.*remove {FILE}: accepted jobs are then queued again"):
        Queue(tmp_path)
