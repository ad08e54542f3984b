import pytest

from ciir.errors import InvalidOption
from ciir.renderer.views import parse_views, spread_indices


def test_named_views():
    assert parse_views("center", 15, 15) == [(7, 7)]
    assert parse_views("cross", 15, 9) == [(0, 4), (7, 0), (7, 4), (7, 8), (14, 4)]
    assert parse_views("cross", 1, 1) == [(0, 0)]
    assert parse_views("all", 2, 3) == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]
    assert parse_views(" 3,4; 0,0;3,4", 5, 5) == [(3, 4), (0, 0)]


@pytest.mark.parametrize("spec", ["", "middle", "1", "1,2,3", "-1,0", "1.5,0", "1,2;", "0,0" * 1000])
def test_text_that_is_not_understood(spec):
    with pytest.raises(InvalidOption, match="give center, cross, all") as error:
        parse_views(spec, 15, 15)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 250


@pytest.mark.parametrize("spec", ["15,0", "0,15", "999999,0"])
def test_views_that_do_not_exist(spec):
    with pytest.raises(InvalidOption, match="0 to 14"):
        parse_views(spec, 15, 15)


@pytest.mark.parametrize(("most", "expected"), [(1, [2]), (2, [2, 8]), (3, [2, 5, 8]), (9, [2, 3, 4, 5, 6, 7, 8])])
def test_indices_are_spread_evenly(most, expected):
    assert spread_indices(2, 9, most).tolist() == expected
