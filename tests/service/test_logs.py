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


def told(capsys, form, tell):
    logs.configure(form)
    tell()
    return capsys.readouterr().err.splitlines()


def test_text(root, capsys):
    def tell():
        token = logs.REQUEST_ID.set("r-1")
        logging.getLogger("ciir.access").info("%s", "hello", extra={logs.FIELDS: {"status": 200}})
        logs.REQUEST_ID.reset(token)
        logging.getLogger("ciir.service.jobs").info("of none")
        logging.getLogger("huey").info("a library's")
        logging.getLogger("huey").warning("which is heard")

    lines = told(capsys, "text", tell)
    assert [line.split(" ", 2)[2] for line in lines] == [
        "INFO ciir.access [r-1] hello",
        "INFO ciir.service.jobs [-] of none",
        "WARNING huey [-] which is heard",
    ]


def test_json_is_one_line_whatever_it_tells(root, capsys):
    def tell():
        try:
            int("two\nlines")
        except ValueError:
            logging.getLogger("ciir").exception("failed\nhere", extra={logs.FIELDS: {"status": 500}})

    (line,) = told(capsys, "json", tell)
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
