import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.service.web.ranges import describe_part, find_part

TAG = '"0123"'


@pytest.mark.parametrize(
    ("text", "first", "end"),
    [
        ("bytes=0-", 0, 100),
        ("bytes=0-0", 0, 1),
        ("bytes=10-19", 10, 20),
        ("Bytes= 90-1000 ", 90, 100),
        ("bytes=-1", 99, 100),
        ("bytes=-1000", 0, 100),
    ],
)
def test_parts(text, first, end):
    part = find_part({"range": text, "if-range": TAG}, TAG, 100)
    assert (part.start, part.stop) == (first, end)
    assert describe_part(part, 100) == f"bytes {first}-{end - 1}/100"


@pytest.mark.parametrize("text", ["bytes=100-", "bytes=100-200", "bytes=-0", "bytes=99999999999999-"])
def test_parts_that_do_not_exist(text):
    part = find_part({"range": text}, TAG, 100)
    assert len(part) == 0
    assert describe_part(part, 100) == "bytes */100"


@pytest.mark.parametrize(
    "text", ["", "bytes=", "bytes=-", "bytes=5-4", "bytes=0-1,3-4", "lines=0-5", "bytes=a-b", "bytes=0-" + "9" * 16]
)
def test_what_stands_for_the_whole_file(text):
    assert find_part({"range": text}, TAG, 100) is None


@pytest.mark.parametrize(
    ("condition", "tag"), [('"other"', TAG), (f"W/{TAG}", TAG), (f"W/{TAG}", f"W/{TAG}"), ("Sat, 28 Nov 2026", TAG)]
)
def test_another_version_is_sent_whole(condition, tag):
    assert find_part({"range": "bytes=5-", "if-range": condition}, tag, 100) is None


def test_no_range_asks_for_all():
    assert find_part({}, TAG, 100) is None


@given(st.integers(0, 20), st.integers(1, 20))
def test_two_parts_join(cut, size):
    whole = bytes(range(size))
    first = find_part({"range": f"bytes=0-{cut}"}, TAG, size)
    rest = find_part({"range": f"bytes={cut + 1}-"}, TAG, size)
    assert whole[first.start : first.stop] + whole[rest.start : rest.stop] == whole
