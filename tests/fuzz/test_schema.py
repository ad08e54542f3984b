"""Schemathesis: thousands of requests that the OpenAPI document allows or just doesn't, and what may come of them."""

import subprocess
import sys

import pytest

from ciir.service.pipeline.options import KINDS

pytestmark = pytest.mark.slow

NOT_ASKED = (
    "positive_data_acceptance",  # a file of random bytes is no mesh: 415 and 422 are the answers
    "ignored_auth",  # without CIIR_API_KEYS anyone may ask; tests/service/web/middleware/test_keys.py holds the rest
    "use_after_free",  # DELETE cancels, and what was cancelled can still be looked at
)


def test_every_answer_is_one_that_the_document_names(hostile_server, tmp_path):
    command = [
        *(sys.executable, "-m", "schemathesis.cli", "run", f"http://127.0.0.1:{hostile_server.port}/openapi.json"),
        *("--phases", "examples,coverage,fuzzing"),  # of 136 links between operations, random data follow none
        *("--max-examples", "5", "--seed", "1", "--no-color", "--exclude-checks", ",".join(NOT_ASKED)),
        *("--generation-database", "none", "--suppress-health-check", "all"),
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)  # noqa: S603 - our own
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr
    others = 4 + 3  # health, readiness, models and metrics; a kept file's POST, GET and DELETE
    assert f"Tested: {5 * len(KINDS) + others}\n" in done.stdout, done.stdout
