"""Edited files, forms and heads at a real server; and right answers beside them."""

import http.client
from contextlib import closing

import pytest

from tests.fuzz.over_http import attack
from tests.load import run

pytestmark = pytest.mark.slow


def test_no_input_brings_about_what_is_not_declared(hostile_server):
    received = attack("127.0.0.1", hostile_server.port, inputs=400, seconds=60, connections=2, seed=1)
    assert [one.error for one in received if one.error] == []
    statuses = {one.status for one in received}
    assert {200, 202, 400, 415, 422} <= statuses  # it is no attack where all goes one way
    with closing(http.client.HTTPConnection("127.0.0.1", hostile_server.port, timeout=10)) as connection:
        connection.request("GET", "/healthz")
        assert connection.getresponse().status == 200


def test_many_at_once_get_what_the_command_line_makes(hostile_server, tmp_path):
    answers, made = tmp_path / "answers", tmp_path / "made"
    answers.mkdir()
    made.mkdir()
    numbers = range(40, 60)  # a round: all kinds, one of them asked for before
    done = run.send_all(hostile_server, numbers, 8, 120, answers)
    assert sorted(done) == list(numbers)
    assert run.list_differences(numbers, answers, made) == []
