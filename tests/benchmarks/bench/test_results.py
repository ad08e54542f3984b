import json

import numpy as np
import pytest

from ciir.benchmarks.bench import figures, tables
from ciir.benchmarks.bench.growth import Line, sphere
from ciir.benchmarks.bench.methods import Method
from ciir.benchmarks.bench.results import Point, as_rows, measured, points
from ciir.benchmarks.bench.run import _finite
from ciir.benchmarks.bench.timing import in_turns, peak_mib, quartiles
from ciir.benchmarks.bench.work import works
from ciir.service.pipeline.options import Options

pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")


def point(method, ms, rmse, kind="float network"):
    return Point(method, kind, "pinhole", 50, ms, rmse)


def test_the_frontier_is_what_nothing_beats_in_both():
    some = [point("a", 1, 9), point("b", 2, 10), point("c", 3, 5), point("d", 3, 6), point("e", 9, 5)]
    direct = point("rays", 0.5, 0.0, figures.DIRECT)
    assert [p.method for p in figures.frontier([*some, direct])] == ["a", "c"]


def test_jobs_take_turns_and_ratios_are_within_a_round():
    order = []
    # The machine slows down by 10 from round to round: a ratio of medians over different rounds would see it.
    slow = {"a": iter([1, 10, 100, 1000]), "b": iter([2, 20, 200, 2000])}

    def job(name):
        def run():
            order.append(name)
            return {"total": float(next(slow[name])), "upscale": 1.0}

        return run

    times = in_turns({"a": job("a"), "b": job("b")}, 3, reference="b")
    assert order == ["a", "b"] * 4
    assert times["a"].ratio == 2.0
    assert (times["a"].median, times["b"].median) == (100.0, 200.0)
    assert times["a"].stages == {"upscale": 1.0}


def test_quartiles():
    assert quartiles([5.0]) == (5.0, 5.0, 5.0)
    assert quartiles([1.0, 2.0, 3.0, 4.0, 5.0]) == (2.0, 3.0, 4.0)


def test_a_method_that_fails_is_printed_as_such():
    work = next(works("vase", "vase", lenses=(8,), array=Options()))
    methods = [
        Method("nearest", "", {"model": "nearest"}, None, "interpolation"),
        Method("gone", "", {"model": "gone"}, None, "float network"),
    ]
    result = measured(work, methods, 1)
    assert list(result.times) == ["nearest"]
    assert "UnknownModel" in result.faults["gone"]
    rows = as_rows([result], methods)
    assert rows[1]["ms_median"] is None
    text = "\n".join(tables.main_tables(rows, {"nearest": "", "gone": ""}))
    assert "not computed: UnknownModel" in text
    assert "| `gone` | - | not computed" in text
    assert [p.method for p in points([result], methods)] == ["nearest"]
    whole = measured(work, methods[:1], 1)
    whole.times["gone"], whole.errors["gone"] = whole.times["nearest"], whole.errors["nearest"]
    # Where it failed on one of two, a mean over the other would flatter.
    assert [p.method for p in points([result, whole], methods)] == ["nearest"]


def test_exponents_are_of_the_upper_half():
    counts = (1, 2, 4, 8, 16)
    assert Line("n", "n^2", counts, tuple(float(max(n, 4) ** 2) for n in counts)).exponent == pytest.approx(2.0)


def test_means_leave_out_what_is_exact_and_miss_nothing():
    assert tables.mean([40.0, float("inf"), 44.0]) == 42.0
    assert tables.mean([float("inf")] * 2) == float("inf")
    assert tables.mean([1.0, None]) is None
    assert tables.mean([]) is None


def test_numbers_that_json_lacks_become_words():
    text = json.dumps(_finite({"a": [float("inf"), float("nan"), 1.5]}), allow_nan=False)
    assert json.loads(text) == {"a": ["inf", "nan", 1.5]}


@pytest.mark.parametrize("triangles", [1000, 30_000])
def test_spheres_have_about_as_many_triangles_as_asked(triangles):
    assert sphere(triangles).triangles == pytest.approx(triangles, rel=0.1)


def test_peak_memory_is_this_process_own():
    before = peak_mib()
    if before is None:
        pytest.skip("the system doesn't tell a process's peak memory")
    block = np.ones(64 * 2**20, np.uint8)
    assert peak_mib() - before > 32 or before > 64 + block.nbytes / 2**20
