import pytest

from ciir.service.web.prefer import Preference


@pytest.mark.parametrize(
    ("given", "is_async", "wait"),
    [
        ([], False, None),
        (["respond-async"], True, None),
        (["Respond-Async, wait=10"], True, 10),
        (["wait=10, respond-async;foo=bar"], True, 10),
        (["handling=lenient", 'wait="5"'], False, 5),
        (["wait=5", "wait=9"], False, 5),
        (["wait=-1, wait=x, wait=1.5, waiting=3, wait"], False, None),
        (["respond-asynchronously"], False, None),
    ],
)
def test_parsing(given, is_async, wait):
    assert Preference.parse(given) == Preference(is_async, wait)


@pytest.mark.parametrize(
    ("preference", "seconds", "applied"),
    [
        (Preference(), 8.0, ""),
        (Preference(is_async=True), 0.0, "respond-async"),
        (Preference(is_async=True, wait=3), 3.0, "respond-async, wait=3"),
        (Preference(wait=0), 0.0, "wait=0"),
        (Preference(wait=60), 8.0, ""),  # longer than the limit
    ],
)
def test_how_long_a_request_waits(preference, seconds, applied):
    assert preference.wait_seconds(8.0) == seconds
    assert preference.format_applied(8.0) == applied
