import json
import logging

import pytest

from ciir.service import logs


@pytest.fixture
def root():
    """The root logger, put back as it was."""
    logger = logging.getLogger()
    before = logger.handlers[:], logger.level
    yield logger
    logger.handlers[:], logger.level = before
    logging.captureWarnings(capture=False)


def log(capsys, form, write):
    logs.configure(form)
    write()
    return capsys.readouterr().err.splitlines()


def test_text(root, capsys):
    def write():
        token = logs.REQUEST_ID.set("r-1")
        logging.getLogger("ciir.access").info("%s", "hello", extra={logs.FIELDS: {"status": 200}})
        logs.REQUEST_ID.reset(token)
        logging.getLogger("ciir.service.jobs").info("no request")
        logging.getLogger("huey").info("a library's")
        logging.getLogger("huey").warning("a warning")
        logging.getLogger("python_multipart.multipart").warning("Expected boundary character 45, got 120 at index 2")

    lines = log(capsys, "text", write)
    assert [line.split(" ", 2)[2] for line in lines] == [
        "INFO ciir.access [r-1] hello",
        "INFO ciir.service.jobs [-] no request",
        "WARNING huey [-] a warning",
    ]


def test_json_is_one_line(root, capsys):
    def write():
        try:
            int("two\nlines")
        except ValueError:
            logging.getLogger("ciir").exception("failed\nhere", extra={logs.FIELDS: {"status": 500}})

    (line,) = log(capsys, "json", write)
    record = json.loads(line)
    assert {name: record[name] for name in ("level", "logger", "message", "request_id", "status")} == {
        "level": "ERROR",
        "logger": "ciir",
        "message": "failed\nhere",
        "request_id": "-",
        "status": 500,
    }
    assert record["time"].endswith("Z")
    assert record["exception"].endswith(r"ValueError: invalid literal for int() with base 10: 'two\nlines'")


def test_lines_on_a_job_have_its_id(root, capsys):
    def write():
        jobs = logging.getLogger("ciir.jobs")
        jobs.warning("job %s: run %d was stopped; queued again", "1a", 1)
        jobs.info("job %s: done", "1a", extra={logs.FIELDS: {"job": "1a", "status": "200"}})
        jobs.warning("job %s is no template")
        jobs.warning("%s can be used again", "the queue")

    found = [json.loads(line).get("job") for line in log(capsys, "json", write)]
    assert found == ["1a", "1a", None, None]
