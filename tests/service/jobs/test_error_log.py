import logging

from ciir.service.jobs.error_log import Trouble


def test_told_once_and_once_when_it_is_over(caplog):
    trouble = Trouble("the queue")
    with caplog.at_level(logging.INFO):
        trouble.is_over()
        for why in ("refused", "refused", "too slow"):
            trouble.begins(why)
        trouble.is_over()
        trouble.is_over()
        trouble.begins("refused")
    assert caplog.messages == [
        "the queue: refused",
        "the queue: too slow",
        "the queue can be used again",
        "the queue: refused",
    ]
