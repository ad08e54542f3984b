import json
import socket
import subprocess
import sys

import pytest

PROGRAM = """
import json, os, socket, sys, tempfile
from pathlib import Path
from ciir import models
from tests.fuzz.guard import Guard
guard = Guard()
Path(sys.argv[1]).read_bytes()
guard.arm()
{}
guard.disarm()
Path(sys.argv[1]).read_bytes()
print(json.dumps(guard.seen))
"""


@pytest.mark.parametrize(
    ("what", "seen"),
    [
        ("Path(sys.argv[1]).read_bytes()", "open"),
        ("os.listdir(os.path.dirname(sys.argv[1]))", "os.listdir"),
        ("socket.create_connection(('127.0.0.1', int(sys.argv[2])))", "socket.connect"),
        ("os.system('true')", "os.system"),
        ("Path('/proc/self/status').read_bytes()", None),
        ("Path(models.__file__).with_name('shipped').joinpath('fast.json').read_bytes()", None),
        ("import colorsys", None),
        ("from importlib.metadata import version; version('numpy')", None),
    ],
)
def test_what_reading_bytes_has_no_need_of_is_seen(tmp_path, what, seen):
    file = tmp_path / "a"
    file.write_bytes(b"x")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        command = [sys.executable, "-c", PROGRAM.format(what), str(file), port]
        done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - our own
    events = [event.partition(" ")[0] for event in json.loads(done.stdout)]
    assert (seen in events) if seen else events == []
