"""A worker process without warm-up, which a test makes fail through its environment."""

import json
import mmap
import os
import sys
import time

from ciir.service.jobs.workers import process, task
from ciir.service.jobs.workers.sandbox import restrictions


def fail(*arguments):
    raise RuntimeError("as the test wants")


task.warm_up = lambda: restrictions.missing.extend(filter(None, [os.environ.get("PYTHON_MISSING")]))
for _ in range(int(os.environ.get("PYTHON_WRITE", "0"))):
    print("\x1b[2J" + 500 * "x" + "\rERROR ciir: a forged line", flush=True)
if "PYTHON_FAIL" in os.environ:
    task.write_result = fail
if "PYTHON_KEEP" in os.environ:
    work, kept = task.write_result, []

    def keep_memory(*arguments):
        """Does the work, and holds `PYTHON_KEEP` bytes of address space from then on."""
        result = work(*arguments)
        kept.append(mmap.mmap(-1, int(os.environ["PYTHON_KEEP"])))
        return result

    task.write_result = keep_memory
if "PYTHON_SEND" in os.environ:
    send = process.Channel.send

    def send_other(self, kind, **fields):
        """Sends the bytes that the test wants instead of the outcome."""
        if kind == "done":
            self._socket.sendall(bytes.fromhex(os.environ["PYTHON_SEND"]))
            time.sleep(1000)
        send(self, kind, **fields)

    process.Channel.send = send_other
if "PYTHON_SLEEP" in os.environ:
    print("it sleeps", flush=True)
    time.sleep(float(os.environ["PYTHON_SLEEP"]))
process.main(**json.loads(sys.argv[1]))
