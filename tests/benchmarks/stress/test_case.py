import math

from benchmarks.stress.case import Found


def test_a_bound_holds_up_to_itself_and_never_for_nan():
    assert Found("x", 1.0, 1.0).holds
    assert not Found("x", 1.0, math.nextafter(1.0, 2.0)).holds
    assert not Found("x", math.inf, math.nan).holds
    assert Found("x", 0, -math.inf).holds
