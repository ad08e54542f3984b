import pytest

from ciir.benchmarks.bench import tables
from ciir.benchmarks.bench.methods import DIRECT, Method
from ciir.benchmarks.bench.results import Point, average_rows, find_frontier, measure
from ciir.benchmarks.bench.timing import time_in_rounds
from ciir.benchmarks.bench.work import list_works
from ciir.service.pipeline.options import Options

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def point(method, ms, rmse, kind="float network"):
    return Point(method, kind, "pinhole", "50x50", ms, rmse)


def test_the_frontier_is_what_nothing_beats_in_both():
    some = [point("a", 1, 9), point("b", 2, 10), point("c", 3, 5), point("d", 3, 6), point("e", 9, 5)]
    direct = point("rays", 0.5, 0.0, DIRECT)
    assert [p.method for p in find_frontier([*some, direct])] == ["a", "c"]


def test_ratios_are_within_a_round():
    order = []
    # The machine slows down by 10 from round to round: a ratio of medians over different rounds would see it.
    slow = {"a": iter([1, 10, 100, 1000]), "b": iter([2, 20, 200, 2000])}

    def job(name):
        def run():
            order.append(name)
            return {"total": float(next(slow[name])), "upscale": 1.0}

        return run

    times = time_in_rounds({"a": job("a"), "b": job("b")}, 3, reference="b")
    assert order == ["a", "b"] * 4
    assert times["a"].ratio == 2.0
    assert (times["a"].low, times["a"].median, times["b"].median) == (55.0, 100.0, 200.0)
    assert times["a"].stages == {"upscale": 1.0}


def test_a_method_that_fails_is_printed_and_left_out_of_means():
    work = next(list_works("vase", "vase", lenses=(8,), array=Options()))
    methods = [
        Method("nearest", {"model": "nearest"}, None, "interpolation"),
        Method("gone", {"model": "gone"}, None, "float network"),
    ]
    rows = measure(work, methods, 1).rows
    assert rows[1]["ms_median"] is None
    text = "\n".join(tables.format_results(rows))
    assert "not computed: UnknownModel" in text
    assert "| `gone` | - | not computed" in text
    whole = [rows[0], rows[0] | {"method": "gone"}]  # where it failed on one of two inputs, a mean would flatter
    assert [p.method for p in average_rows(rows + whole)] == ["nearest"]


def test_means_leave_out_what_is_exact_and_miss_nothing():
    assert tables.average([40.0, float("inf"), 44.0]) == 42.0
    assert tables.average([float("inf")] * 2) == float("inf")
    assert tables.average([1.0, None]) is None
    assert tables.average([]) is None
