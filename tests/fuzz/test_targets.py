"""A few hundred inputs for each target; `python -m tests.fuzz.run` tries millions."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.exceptions import HTTPException

from ciir.errors import Unreadable
from tests.fuzz.mutate import KINDS, MOST_BYTES, WORDS, Edit, apply_edits
from tests.fuzz.targets import TARGETS, BrokenPromise, Target

pytestmark = pytest.mark.slow

REFUSED_SEEDS = {"zip": 1, "any": 1, "inspection": 1, "options-eia": 5, "options-mesh": 5}
"""An empty zip, and options for the other kind of input; all other seeds are read."""
EDITS = st.lists(
    st.builds(
        Edit,
        kind=st.sampled_from(KINDS),
        where=st.floats(0, 1),
        length=st.integers(1, MOST_BYTES),
        word=st.one_of(st.sampled_from(WORDS), st.binary(max_size=8)),
    ),
    max_size=5,
)


def inputs_near(made):
    return st.one_of(st.builds(apply_edits, st.sampled_from(made), EDITS), st.binary())


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_read(name):
    made = TARGETS[name].seeds()
    assert made == TARGETS[name].seeds()
    assert sum(not TARGETS[name](seed) for seed in made) == REFUSED_SEEDS.get(name, 0)


@pytest.mark.parametrize("name", TARGETS)
def test_hostile_bytes_are_read_or_refused_in_one_line(name):
    target = TARGETS[name]
    seen = {True: 0, False: 0}

    @settings(max_examples=150, suppress_health_check=list(HealthCheck))
    @given(inputs_near(target.seeds()))
    def hold(data):
        seen[target(data)] += 1

    hold()
    assert min(seen.values()) > 0, seen  # it is no test where all goes one way


@pytest.mark.parametrize(
    ("error", "broken"),
    [
        (Unreadable("a: cut short; give it again"), False),
        (HTTPException(400, "the form is cut short"), False),
        (Unreadable("two\nlines, and more"), True),
        (Unreadable("a: cut\0short; give it again"), True),
        (Unreadable("no"), True),
        (Unreadable("long " * 200), True),
    ],
)
def test_a_refusal_is_a_line(error, broken):
    def check(_):
        raise error

    target = Target(check, list)
    if broken:
        with pytest.raises(BrokenPromise, match="no line"):
            target(b"")
    else:
        assert target(b"") is False
