import json

import pytest

from renderer import backends
from renderer.scenes import scene
from service import cache, cost
from service.cost import Costs


@pytest.fixture
def path(tmp_path):
    return tmp_path / "new" / "costs.json"


def never():
    raise AssertionError("measured")


def test_what_was_measured_is_kept(path):
    costs = Costs(path)
    assert costs.of("rays", lambda: (1.0, 2.0)) == (1.0, 2.0)
    assert costs.of("rays", never) == (1.0, 2.0)
    assert Costs(path).of("rays", never) == (1.0, 2.0)
    assert not Costs(path).trouble
    assert json.loads(path.read_bytes()) == {"machine": cost.machine(), "ms": {"rays": [1.0, 2.0]}}
    assert [file.name for file in path.parent.iterdir()] == ["costs.json"]


def test_two_processes_keep_what_each_measured(path):
    one, other = Costs(path), Costs(path)
    one.of("a", lambda: (1.0, 3.0))
    other.of("b", lambda: (2.0, 3.0))
    assert Costs(path).of("a", never) == (1.0, 3.0)
    assert Costs(path).of("b", never) == (2.0, 3.0)


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "{}", '{"machine": "MACHINE", "ms": 3}', '{"machine": "MACHINE", "ms": {"rays": ["x"]}}',
        '{"machine": "MACHINE", "ms": {"rays": 1}}', '{"machine": "MACHINE", "ms": {"rays": [NaN, 1]}}',
        '{"machine": "MACHINE", "ms": {"rays": [-1, 1]}}', '{"machine": "MACHINE", "ms": {"rays": [1]}}',
        '{"machine": "another", "ms": {"rays": [1, 1]}}',
    ],
)  # fmt: skip
def test_another_machine_or_a_broken_file_is_measured_again(path, text):
    path.parent.mkdir()
    path.write_text(text.replace("MACHINE", cost.machine()))
    assert Costs(path).of("rays", lambda: (3.0, 4.0)) == (3.0, 4.0)
    assert Costs(path).of("rays", never) == (3.0, 4.0)


def test_where_nothing_can_be_kept_it_is_said(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    for costs in (Costs(None), Costs(tmp_path / "file" / "costs.json")):
        assert costs.of("rays", lambda: (1.0, 2.0)) == (1.0, 2.0)
        assert costs.of("rays", never) == (1.0, 2.0)
        assert costs.trouble
        assert "\n" not in costs.trouble


def test_rendering_is_linear(path, monkeypatch):
    monkeypatch.setattr(backends, "_open", {"raster": None})
    costs = Costs(path)
    costs.of("rays", lambda: (0.5, 0.25))
    costs.of("opengl", lambda: (0.5, 0.125, 0.25, 2.0))
    vase, globe = scene("vase"), scene("globe")
    assert costs.rendering("raytrace", vase, rays=8, views=3) == 0.5 * vase.triangles + 3 * 8 * 0.25
    assert costs.rendering("raster", vase, rays=8, views=3) == 0.5 * vase.triangles + 3 * (
        0.25 * vase.triangles + 8 * 2.0
    )
    texels = 720 * 1440
    assert costs.rendering("raster", globe, rays=0, views=0) == 0.5 * globe.triangles + 0.125 * texels


def test_opengl_is_not_started_to_be_measured(path, monkeypatch):
    monkeypatch.setattr(backends, "_open", {})
    monkeypatch.setattr(cost, "opengl_cost", never)
    typical = Costs(path).rendering("raster", scene("vase"), rays=100, views=1)
    assert cost.OPENGL_START_MS < typical < cost.OPENGL_START_MS + 100
    costs = Costs(path)
    costs.of("opengl", lambda: (0.0, 0.0, 0.0, 1.0))  # another process had it open
    assert costs.rendering("raster", scene("vase"), rays=100, views=1) == cost.OPENGL_START_MS + 100


def test_upscaling_is_linear_and_each_model_has_its_own(path, monkeypatch):
    asked = []

    def measured(model, scale, *, is_light_field):
        asked.append((model, scale, is_light_field))
        return 1.0, 0.5

    monkeypatch.setattr(cost, "network_cost", measured)
    costs = Costs(path)
    assert costs.upscaling("bicubic", 3, pixels=10, views=4) == 4 * (1 + 5)
    for model in ("fast", "field", "fast"):
        assert costs.upscaling(model, 2, pixels=10, views=4) - 24 in (0, cost.NETWORK_START_MS)
    assert asked == [("bicubic", 3, False), ("fast", 2, False), ("field", 2, True)]
    assert all(len(name.split()) == 3 for name in costs._known if "bicubic" not in name)  # with the network's SHA-256


def test_coefficients_are_positive_and_those_of_known_work():
    assert cost.slope(10, 30, 100, 300) == pytest.approx(0.1)
    assert cost.slope(30, 30, 100, 300) == pytest.approx(0.05)  # noise: half of the mean
    for measured in (cost.rays_cost(), cost.network_cost("bicubic", 2, is_light_field=False)):
        assert len(measured) == 2
        assert min(measured) >= 0
        assert max(measured) > 0


def test_the_quickest_round_counts_and_what_others_took_does_not(monkeypatch):
    now = {"wall": 0.0, "cores": 0.0}
    monkeypatch.setattr(cost.time, "perf_counter", lambda: now["wall"])
    monkeypatch.setattr(cost.time, "process_time", lambda: now["cores"])
    runs = []

    def job(name, wall, cores):
        def run():
            runs.append(name)
            now["wall"] += wall * (2 if len(runs) % 3 else 1)
            now["cores"] += cores

        return run

    assert cost.least(job("a", 0.01, 0.02), job("b", 0.03, 0.004)) == [pytest.approx(10), pytest.approx(4)]
    assert runs[:6] == ["a", "b"] * 3
    assert len(runs) >= 2 * cost.ROUNDS + 2
    assert cost.least(job("c", 0.01, 0.012), cores=2.0) == [pytest.approx(6)]


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
    assert str(cache.folder()) == expected


def test_a_process_without_a_home(monkeypatch):
    for name in ("CIIR_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(cache.Path, "home", homeless)
    assert cache.folder() is None
