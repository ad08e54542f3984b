"""A worker process without warm-up, which a test makes fail through its environment."""

import json
import os
import sys
import time

from ciir.service.jobs.workers import process, task
from ciir.service.jobs.workers.sandbox import restrictions


def fail(*arguments):
    raise RuntimeError("as the test wants")


task.warm_up = lambda: restrictions.missing.extend(filter(None, [os.environ.get("PYTHON_MISSING")]))
if "PYTHON_FAIL" in os.environ:
    task.write_result = fail
if "PYTHON_SLEEP" in os.environ:
    print("it sleeps", flush=True)
    time.sleep(float(os.environ["PYTHON_SLEEP"]))
process.main(**json.loads(sys.argv[1]))
