import logging
from contextlib import suppress

import pytest

from ciir.errors import QueueUnavailable
from ciir.service.jobs.resource import Resource


def use(resource, error=None):
    with resource.use():
        if error is not None:
            raise error


def test_errors_are_logged_when_they_begin_and_when_they_are_over(caplog):
    resource = Resource("the queue", lambda error: "not now")
    with caplog.at_level(logging.INFO):
        for reason in (None, "refused", "refused", "too slow", None, None, "refused"):
            with suppress(QueueUnavailable):
                use(resource, reason and OSError(reason))
    assert caplog.messages == [
        "the queue: refused",
        "the queue: too slow",
        "the queue can be used again",
        "the queue: refused",
    ]


def test_only_errors_of_the_resource_are_translated():
    resource = Resource("the queue", lambda error: "not now" if isinstance(error, OSError) else None)
    with pytest.raises(QueueUnavailable, match="not now"):
        use(resource, OSError())
    with pytest.raises(KeyError):
        use(resource, KeyError())
