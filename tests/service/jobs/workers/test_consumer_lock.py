import subprocess
import sys

from ciir.service.jobs.workers.consumer_lock import ConsumerLock

HOLD = """
import sys
from pathlib import Path
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
lock = ConsumerLock(Path(sys.argv[1]))
print(lock.name, flush=True)
sys.stdin.read()
"""


def test_consumers_of_one_process(tmp_path):
    one, other = ConsumerLock(tmp_path), ConsumerLock(tmp_path)
    assert one.name != other.name
    assert set(one.list_names()) == {one.name, other.name}
    assert not one.is_dead(other.name)
    assert not one.is_dead(one.name)
    assert (one.count_others(), other.count_others()) == (1, 1)
    other.close()
    assert one.list_names() == [one.name]
    assert not one.is_dead("of another machine")
    one.close()


def test_the_consumer_of_a_killed_process_is_dead_at_once(tmp_path):
    lock = ConsumerLock(tmp_path)
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        name = process.stdout.readline().strip()
        assert not lock.is_dead(name)
        process.kill()
        process.wait()
    assert lock.is_dead(name)
    assert lock.count_others() == 0
    lock.remove(name)
    assert lock.list_names() == [lock.name]
    lock.close()
