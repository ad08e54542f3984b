import logging

from ciir.service.jobs.error_log import ErrorLog


def test_errors_are_logged_when_they_begin_and_when_they_are_over(caplog):
    log = ErrorLog("the queue")
    with caplog.at_level(logging.INFO):
        log.log_success()
        for reason in ("refused", "refused", "too slow"):
            log.log_error(reason)
        log.log_success()
        log.log_success()
        log.log_error("refused")
    assert caplog.messages == [
        "the queue: refused",
        "the queue: too slow",
        "the queue can be used again",
        "the queue: refused",
    ]
