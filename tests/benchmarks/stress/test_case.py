import json
import math

import numpy as np

from ciir.benchmarks.stress.case import Found


def test_a_bound_holds_up_to_itself_and_never_for_nan():
    assert Found("x", 1.0, 1.0).holds
    assert not Found("x", 1.0, math.nextafter(1.0, 2.0)).holds
    assert not Found("x", math.inf, math.nan).holds
    assert Found("x", 0, -math.inf).holds


def test_json_takes_what_numpy_measured():
    assert json.dumps(Found("x", 1.0, float(np.float64(0.5))).holds) == "true"
    assert Found("x", np.int64(3), np.float32(2)).holds is True
