import subprocess
import sys

from ciir.service.jobs.workers.consumer_lock import ConsumerLock

HOLD = """
import sys
from pathlib import Path
from ciir.service.jobs.workers.consumer_lock import ConsumerLock
owner = ConsumerLock(Path(sys.argv[1]))
print(owner.name, flush=True)
sys.stdin.read()
"""


def test_of_this_process(tmp_path):
    one, other = ConsumerLock(tmp_path), ConsumerLock(tmp_path)
    assert one.name != other.name
    assert set(one.names()) == {one.name, other.name}
    assert not one.is_gone(other.name)
    assert not one.is_gone(one.name)
    other.close()
    assert one.names() == [one.name]
    assert not one.is_gone("of another machine")
    one.close()


def test_a_process_that_is_killed_is_gone_at_once(tmp_path):
    owner = ConsumerLock(tmp_path)
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        name = process.stdout.readline().strip()
        assert not owner.is_gone(name)
        process.kill()
        process.wait()
    assert owner.is_gone(name)
    owner.forget(name)
    assert owner.names() == [owner.name]
    owner.close()
