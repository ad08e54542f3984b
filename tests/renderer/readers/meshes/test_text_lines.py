"""Lines by array against a loop over lines."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ciir.renderer.readers.meshes.text_lines import count_in_rows, list_words, sort_lines

WORDS = (b"v", b"vt", b"f")
PIECES = [
    b"v",
    b"V",
    b"vt",
    b"vT",
    b"f",
    b"v ",
    b" ",
    b"\t",
    b"\r",
    b"\n",
    b"#",
    b"1",
    b"-2.5",
    b"3/4",
    b"usemtl a",
    b"\v",
]
TEXTS = st.lists(st.sampled_from(PIECES), max_size=40).map(b"".join)


def split_lines(text):
    """Number, first word and the others of each line that has words."""
    lines = [line.split() for line in text.split(b"\n")]
    return [(number, line[0], line[1:]) for number, line in enumerate(lines) if line]


@given(TEXTS)
def test_lines_and_their_words(text):
    rows = sort_lines(text, WORDS)
    lines = split_lines(text)
    for word in WORDS:
        found = rows[word]
        expected = [(number, rest) for number, first, rest in lines if first.lower() == word]
        assert found.numbers.tolist() == [number for number, _ in expected]
        assert found.widths.tolist() == [len(rest) for _, rest in expected]
        for most in (None, 1, 2):
            listed = list(list_words(found.join(text), found.widths, most))
            assert listed == [word for _, rest in expected for word in rest[:most]]


@given(TEXTS, st.integers(0, 2**40))
def test_marks_are_counted_in_any_rows(text, chosen):
    every = sort_lines(text, WORDS)[b"v"]
    rows = every.select(np.array([chosen >> place & 1 for place in range(len(every))], bool))
    joined = rows.join(text)
    slashes = [text[start:end].count(b"/") for start, end in zip(rows.starts, rows.ends, strict=True)]
    assert count_in_rows(np.frombuffer(joined, np.uint8) == ord("/"), rows).tolist() == slashes
