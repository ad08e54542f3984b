import io
import os
import threading

import pytest

from renderer.errors import InvalidOption
from service.store import ABANDONED_SECONDS, SUFFIX, Store

HEAD = {"format": "png", "report": {"notes": ["ä"]}}


def filled(folder, limit=10_000, **bodies):
    store = Store(folder, limit)
    for number, (key, body) in enumerate(bodies.items()):
        store.put(key, HEAD, io.BytesIO(body))
        os.utime(folder / f"{key}{SUFFIX}", (number, number))
    return store


def there(folder):
    return {path.name.removesuffix(SUFFIX) for path in folder.iterdir()}


def body(store, key):
    found = store.get(key)
    if found is None:
        return None
    with found.body:
        assert found.head == HEAD
        data = found.body.read()
        assert len(data) == found.size
        return data


def test_what_was_put_comes_back(tmp_path):
    store = Store(tmp_path / "new" / "folder", 10_000)
    assert store.get("a") is None
    given = io.BytesIO(b"views")
    given.read()
    assert store.put("a", HEAD, given)
    assert given.read() == b"views"  # it stands at its beginning again
    assert body(store, "a") == b"views"
    store.put("a", HEAD, io.BytesIO(b"others"))
    assert body(Store(tmp_path / "new" / "folder", 10_000), "a") == b"others"
    assert there(tmp_path / "new" / "folder") == {"a"}


def test_nobody_else_can_read_it(tmp_path):
    filled(tmp_path / "own", a=b"x")
    assert (tmp_path / "own").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[:20],
        lambda data: data[:-1],
        lambda data: data + b"x",
        lambda data: data[:-1] + bytes([data[-1] ^ 1]),
        lambda data: data[:45] + b"?" + data[46:],
        lambda data: b"\xff" * 8 + data[8:],
        lambda data: bytes([data[0] ^ 1]) + data[1:],
    ],
    ids=["empty", "short", "cut", "longer", "body", "head", "huge head", "other head"],
)
def test_damaged_files_are_noticed_and_removed(tmp_path, damage):
    store = filled(tmp_path, a=b"views", b=b"views")
    path = tmp_path / f"a{SUFFIX}"
    path.write_bytes(damage(path.read_bytes()))
    assert store.get("a") is None
    assert there(tmp_path) == {"b"}
    assert body(store, "b") == b"views"


def test_the_longest_unused_go_where_room_is_needed(tmp_path):
    store = filled(tmp_path, 4000, old=bytes(1000), older=bytes(1000), new=bytes(1000))
    assert body(store, "old") is not None  # its use makes it the newest
    assert store.put("newest", HEAD, io.BytesIO(bytes(1500)))
    assert there(tmp_path) == {"old", "new", "newest"}
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 4000


def test_what_is_over_the_limit_alone_is_not_kept_and_displaces_nothing(tmp_path):
    store = filled(tmp_path, 4000, a=bytes(1000))
    large = io.BytesIO(bytes(4000))
    assert not store.put("b", HEAD, large)
    assert large.tell() == 0
    assert there(tmp_path) == {"a"}


def test_others_files_stay_and_what_the_dead_left_goes(tmp_path):
    store = filled(tmp_path, 2000, a=bytes(1000))
    (tmp_path / "mine.txt").write_bytes(bytes(5000))
    for name, age in ((f".b{SUFFIX}.0123.partial", 2 * ABANDONED_SECONDS), (f".c{SUFFIX}.0123.partial", 0)):
        path = tmp_path / name
        path.write_bytes(b"half")
        used = path.stat().st_mtime - age
        os.utime(path, (used, used))
    store.put("d", HEAD, io.BytesIO(bytes(1000)))
    assert there(tmp_path) == {"mine.txt", f".c{SUFFIX}.0123.partial", "d"}


def test_keys_are_no_paths(tmp_path):
    for key in ("../a", "a/b", "", ".", "a" * 129):
        with pytest.raises(InvalidOption, match="no key"):
            Store(tmp_path, 1000).get(key)


def test_several_writers_and_readers_see_whole_results_only(tmp_path):
    bodies = [bytes([number]) * 3000 for number in range(8)]
    wrong = []

    def work(number):
        store = Store(tmp_path, 10_000)  # room for three
        for turn in range(20):
            key = str((number + turn) % 4)
            found = body(store, key)
            if found is not None and found not in bodies:
                wrong.append(found)
            store.put(key, HEAD, io.BytesIO(bodies[number]))

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    Store(tmp_path, 10_000).put("last", HEAD, io.BytesIO(b"x"))
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 10_000
