import pytest

from ciir.service.cli.commands.serve import is_open


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
