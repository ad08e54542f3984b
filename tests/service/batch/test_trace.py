"""What a task read, and whether it is still so."""

import pytest

pytest.importorskip("fsspec")

from ciir.service.batch.trace import TracedFiles, compute_key, matches
from ciir.service.pipeline.options import Options

FILES = {"a.png": b"a", "b.png": b"b"}


def test_only_what_was_read_counts():
    traced = TracedFiles(FILES)
    assert traced["a.png"] == b"a"
    assert "a.json" not in traced
    assert matches(traced.trace, FILES)
    assert matches(traced.trace, {**FILES, "b.png": b"other", "c.png": b""})
    assert not matches(traced.trace, {**FILES, "a.png": b"other"})
    assert not matches(traced.trace, {**FILES, "a.json": b""})
    assert not matches(traced.trace, {"b.png": b"b"})


def test_new_names_count_where_names_were_listed():
    traced = TracedFiles(FILES)
    assert list(traced) == ["a.png", "b.png"]
    assert matches(traced.trace, {**FILES, "b.png": b"other"})
    assert not matches(traced.trace, {**FILES, "c.png": b""})


def test_the_start_of_a_file_alone_does_not_count():
    traced = TracedFiles(FILES)
    assert traced.read_start("a.png", 100) == FILES["a.png"]
    assert matches(traced.trace, {})


def test_a_file_that_was_missing_counts():
    traced = TracedFiles(FILES)
    with pytest.raises(KeyError):
        traced["c.png"]
    assert not matches(traced.trace, {**FILES, "c.png": b""})


def test_the_key_depends_on_the_options_and_the_settings():
    keys = {
        compute_key("a", options=Options()),
        compute_key("b", options=Options()),
        compute_key("a", options=Options(scale=3)),
    }
    assert len(keys) == 3
