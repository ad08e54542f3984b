import json

import pytest

from ciir.service.cli.commands.serve import find_url, is_open
from tests.support.servers import run_server


@pytest.mark.parametrize(
    ("host", "keys", "expected"),
    [
        ("127.0.0.1", 0, False),
        ("127.8.0.1", 0, False),
        ("::1", 0, False),
        ("0.0.0.0", 0, True),  # noqa: S104 - only looked at
        ("0.0.0.0", 1, False),  # noqa: S104 - only looked at
        ("::", 0, True),
        ("fe80::1%eth0", 0, True),
        ("192.168.1.2", 0, True),
    ],
)
def test_is_open(host, keys, expected):
    assert is_open(host, keys) is expected


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", "http://127.0.0.1:8000"),
        ("::1", "http://[::1]:8000"),
        ("0.0.0.0", "http://localhost:8000"),  # noqa: S104 - only looked at
        ("::", "http://localhost:8000"),
        ("fe80::1%eth0", "http://[fe80::1%eth0]:8000"),
    ],
)
def test_the_address_can_be_opened(host, expected):
    assert find_url(host, 8000) == expected


def test_all_lines_of_the_log_are_in_its_format(tmp_path):
    log = tmp_path / "log"
    with run_server(log, CIIR_WORKERS="0", CIIR_LOG_FORMAT="json", CIIR_NOPE="1"):
        pass
    messages = [json.loads(line)["message"] for line in log.read_text().splitlines()]
    assert sum("CIIR_NOPE is set, but is not a setting" in message for message in messages) == 1
    assert sum("is the web page; /docs describes the API" in message for message in messages) == 1
    assert sum(f"jobs are in {tmp_path / 'service'}, inputs and results in" in message for message in messages) == 1
