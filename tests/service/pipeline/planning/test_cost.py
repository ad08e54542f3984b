import json
import math
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import BackendUnavailable
from ciir.models import catalogue
from ciir.renderer import backends
from ciir.service.pipeline import cache_folder
from ciir.service.pipeline.planning import cost
from ciir.service.pipeline.planning.cost import Costs, Rendering, Stage

INTERPOLATION = {"bicubic x2, interpolation; here": 0.5}


@pytest.fixture
def path(tmp_path, monkeypatch):
    """A costs file in a folder that is not there yet, of a machine called `here`."""
    monkeypatch.setattr(cost, "machine", lambda: "here")
    return tmp_path / "new" / "costs.json"


def write(path, content):
    path.parent.mkdir(exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return Costs(path)


@pytest.fixture
def measured(monkeypatch):
    """The milliseconds that each measurement takes; a list, emptied from its end."""
    results = []
    monkeypatch.setattr(cost, "measure", lambda run: results.pop())
    return results


def bicubic(costs):
    """Milliseconds of a pixel that is interpolated."""
    return costs.upscaling("bicubic", 2, pixels=1000, views=1, batches=0).views / (1000 + cost.VIEW_PIXELS)


WORK = cost.VIEWS * (cost.SIDE**2 + cost.VIEW_PIXELS) + cost.CALL_PIXELS
"""Pixels that a measurement of a model counts."""


def test_measurements_are_kept(path, measured):
    measured += [2.0 * WORK]
    costs = Costs(path)
    assert [bicubic(costs), bicubic(costs), bicubic(Costs(path))] == pytest.approx([2.0] * 3)
    assert costs.not_kept == ""
    assert json.loads(path.read_bytes()) == {"bicubic x2, interpolation; here": 2.0}
    assert [file.name for file in path.parent.iterdir()] == ["costs.json"]


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", "3", '"x"', "{}", '{"NAME": "x"}', '{"NAME": null}', '{"NAME": NaN}', '{"NAME": -1.0}',
     '{"NAME": [1.0]}', '{"bicubic x2, interpolation; elsewhere": 1.0}', "\xff", "[" * 100_000],
)  # fmt: skip
def test_a_damaged_file_or_one_of_another_machine_is_measured_again(path, measured, content):
    costs = write(path, content.replace("NAME", next(iter(INTERPOLATION))))
    measured += [3.0 * WORK]
    assert bicubic(costs) == pytest.approx(3.0)
    assert bicubic(Costs(path)) == pytest.approx(3.0)


def test_a_folder_that_cannot_be_written_is_reported(tmp_path, measured):
    (tmp_path / "file").write_bytes(b"")
    for costs in (Costs(None), Costs(tmp_path / "file" / "costs.json")):
        measured += [1.0]
        assert bicubic(costs) == bicubic(costs)
        assert costs.not_kept
        assert "\n" not in costs.not_kept


def test_rendering_is_scaled_to_this_machine(path):
    costs = write(path, {"raytrace; here": 2.5})
    some = Rendering("raytrace", triangles=1000, rays=100, views=2)
    once, views, _ = some.typical()
    assert costs.rendering(some) == Stage(2.5 * once, 2.5 * views)


def test_opengl_is_not_started_to_be_measured(path, monkeypatch):
    monkeypatch.setattr(backends.selection, "_open", {})
    some = Rendering("raster", triangles=1000, rays=100, views=2)
    once, views, _ = some.typical()
    assert Costs(path).rendering(some) == Stage(cost.OPENGL_START_MS + once, views)
    costs = write(path, {"raster; here": 2.0})  # by a process that had it open
    assert costs.rendering(some) == Stage(cost.OPENGL_START_MS + 2 * once, 2 * views)
    monkeypatch.setattr(backends.selection, "_open", {"raster": None})
    assert costs.rendering(some) == Stage(2 * once, 2 * views)


def test_upscaling_is_linear_and_each_network_is_measured(path, measured, monkeypatch):
    monkeypatch.setattr(cost, "_upscaler", lambda model, scale: None)
    monkeypatch.setattr(cost, "count_available_cores", lambda: 4)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    measured += [3.0 * WORK, 2.0 * WORK]
    costs = Costs(path)
    pixels = 5 * (100 + cost.VIEW_PIXELS) + 2 * cost.CALL_PIXELS
    for model, ms in (("fast", 2.0), ("field", 3.0), ("fast", 2.0)):
        assert costs.upscaling(model, 2, pixels=100, views=5, batches=2) == Stage(0.0, pytest.approx(ms * pixels), 4)
    monkeypatch.delitem(sys.modules, "onnxruntime")
    assert costs.upscaling("fast", 2, pixels=100, views=5, batches=2).once == cost.NETWORK_START_MS
    for name in json.loads(path.read_bytes()):
        (card,) = [entry.card for entry in catalogue.list_entries() if name.startswith(f"{entry.name} x2, ")]
        assert card.sha256[:12] in name


@pytest.mark.usefixtures("instant")
def test_the_stages_of_many_batches_overlap(monkeypatch):
    slow, light, both = Stage(1.0, 100.0), Stage(1.0, 20.0), Stage(1.0, 100.0, 2)
    assert cost.total([slow, light], 0, 10) == pytest.approx(2 + 12 + 0.9 * 100)  # as fast as the slowest
    assert cost.total([both, light], 0, 10) == pytest.approx(2 + 12 + 0.9 * 110)  # no core is left for the other
    monkeypatch.setattr(cost, "count_available_cores", lambda: 1)
    assert cost.total([slow, light], 0, 10) == pytest.approx(2 + 120)


@settings(max_examples=100)
@given(st.lists(st.floats(0, 1e4), min_size=1, max_size=4), st.integers(1, 99), st.integers(0, 10**6))
def test_overlapping_stages_take_at_least_the_slowest_and_at_most_the_sum(given, batches, written):
    writing = written * cost.WRITE_MS
    stages = [Stage(0.0, ms) for ms in given]
    found = cost.total(stages, written, batches) - cost.JOB_MS
    assert max(*given, writing) <= found + 1e-6
    assert found <= sum(given) + writing + 1e-6  # float64: some 1e-12 of sums up to 4e4
    assert found <= cost.total(stages, written, max(1, batches - 1)) - cost.JOB_MS + 1e-6


@pytest.mark.parametrize(
    ("cores", "wall", "work", "expected"),
    [(4, 0.010, 0.020, 10), (4, 0.030, 0.030, 30), (4, 0.010, 0.080, 20), (4, 0.100, 0.050, 50), (1, 0.030, 0.030, 30)],
)
def test_other_processes_do_not_count(monkeypatch, cores, wall, work, expected):
    """They hold the cores in two rounds of three, which then take twice as long."""
    clock, runs = {"wall": 0.0, "work": 0.0}, []

    def run():
        runs.append(None)
        clock["wall"] += wall * (1 if len(runs) % 3 == 0 else 2)
        clock["work"] += work

    monkeypatch.setattr(cost.time, "perf_counter", lambda: clock["wall"])
    monkeypatch.setattr(cost.time, "process_time", lambda: clock["work"])
    monkeypatch.setattr(cost, "count_available_cores", lambda: cores)
    assert cost.measure(run) == pytest.approx(expected)
    assert len(runs) > cost.ROUNDS


@pytest.mark.parametrize("backend", ["raytrace", "raster"])
def test_a_backend_is_measured(backend, monkeypatch):
    monkeypatch.setattr(cost, "LEAST_MS", 0.0)
    try:
        assert 0 < cost._factor(backend) < math.inf
    except BackendUnavailable as error:
        pytest.skip(str(error))


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"CIIR_CACHE": "/a", "XDG_CACHE_HOME": "/b", "HOME": "/c"}, "/a"),
        ({"XDG_CACHE_HOME": "/b", "HOME": "/c"}, "/b/ciir"),
        ({"HOME": "/c"}, "/c/.cache/ciir"),
    ],
)
def test_the_cache_folder(monkeypatch, environment, expected):
    for name in ("CIIR_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert str(cache_folder.folder()) == expected


def test_typical_costs_are_taken_where_nothing_is_measured(path, measured):
    costs = Costs(path, measure=False)
    networks = {entry.name: entry.card for entry in catalogue.list_entries()}
    ms = {}
    for name in ("fast", "field", "fast-int8", "bicubic"):
        ms[name] = costs.upscaling(name, 2, pixels=1000, views=1, batches=0).views / (1000 + cost.VIEW_PIXELS)
    assert ms["bicubic"] == cost.TYPICAL_INTERPOLATION_MS
    assert ms["field"] == pytest.approx(4 * networks["field"].macs_per_output_pixel * cost.TYPICAL_MAC_MS["float32"])
    assert ms["fast-int8"] < ms["fast"] < ms["field"]
    some = Rendering("raytrace", triangles=1000, rays=100, views=2)
    assert costs.rendering(some) == some.typical()
    assert not path.exists()
    kept = write(path, INTERPOLATION)
    assert bicubic(Costs(path, measure=False)) == bicubic(kept) == pytest.approx(0.5)
