import json
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.renderer import backends
from ciir.renderer.scenes import scene
from ciir.service.pipeline import cache_folder, cost
from ciir.service.pipeline.cost import Costs, Stage
from ciir.service.pipeline.measuring import Network, OpenGL, Rays


@pytest.fixture
def path(tmp_path):
    return tmp_path / "new" / "costs.json"


def never():
    raise AssertionError("measured")


def test_what_was_measured_is_kept(path):
    costs = Costs(path)
    assert costs.of("png", lambda: (1.0, 2.0)) == (1.0, 2.0)
    assert costs.of("png", never) == (1.0, 2.0)
    assert Costs(path).of("png", never) == (1.0, 2.0)
    assert not Costs(path).trouble
    assert json.loads(path.read_bytes()) == {"machine": cost.machine(), "ms": {"png": [1.0, 2.0]}}
    assert [file.name for file in path.parent.iterdir()] == ["costs.json"]


def test_two_processes_keep_what_each_measured(path):
    one, other = Costs(path), Costs(path)
    one.of("a", lambda: (1.0,) * 6)
    other.of("b", lambda: (2.0,) * 6)
    assert Costs(path).of("a", never) == (1.0,) * 6
    assert Costs(path).of("b", never) == (2.0,) * 6


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", "{}", '{"machine": "MACHINE", "ms": 3}', '{"machine": "MACHINE", "ms": {"png": ["x", 1]}}',
        '{"machine": "MACHINE", "ms": {"png": 1}}', '{"machine": "MACHINE", "ms": {"png": [NaN, 1]}}',
        '{"machine": "MACHINE", "ms": {"png": [-1, 1]}}', '{"machine": "MACHINE", "ms": {"png": [1]}}',
        '{"machine": "another", "ms": {"png": [1, 1]}}',
    ],
)  # fmt: skip
def test_another_machine_or_a_broken_file_is_measured_again(path, text):
    path.parent.mkdir()
    path.write_text(text.replace("MACHINE", cost.machine()))
    assert Costs(path).of("png", lambda: (3.0, 4.0)) == (3.0, 4.0)
    assert Costs(path).of("png", never) == (3.0, 4.0)


def test_where_nothing_can_be_kept_it_is_said(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    for costs in (Costs(None), Costs(tmp_path / "file" / "costs.json")):
        assert costs.of("png", lambda: (1.0, 2.0)) == (1.0, 2.0)
        assert costs.of("png", never) == (1.0, 2.0)
        assert costs.trouble
        assert "\n" not in costs.trouble


def test_rendering_is_linear(path, monkeypatch):
    monkeypatch.setattr(backends, "_open", {"raster": None})
    costs = Costs(path)
    costs.of("rays", lambda: Rays(scene=7.0, triangle=0.5, view=3.0, ray=0.25, textured=1.0))
    costs.of("opengl", lambda: OpenGL(5.0, 0.5, 0.125, 3.0, 0.25, 2.0, 1.0, 1.5))
    vase, globe = scene("vase"), scene("globe")
    of_vase = costs.rendering("raytrace", vase, rays=8, views=3, culls=False)
    assert of_vase == Stage(7 + 0.5 * vase.triangles, 3 * (3 + 8 * 0.25), 1.0)
    of_vase = costs.rendering("raster", vase, rays=8, views=3, culls=False)
    assert of_vase == Stage(5 + 0.5 * vase.triangles, 3 * (3 + 0.25 * vase.triangles + 8 * 2), 1.5)
    textured = sum(len(part.faces) for part in globe.parts if part.texture is not None) / globe.triangles
    assert costs.rendering("raytrace", globe, rays=8, views=1, culls=False).views == pytest.approx(
        3 + 8 * (0.25 + textured)
    )
    of_globe = costs.rendering("raster", globe, rays=8, views=1, culls=False)
    assert of_globe.once == 5 + 0.5 * globe.triangles + 0.125 * 720 * 1440
    assert of_globe.views == pytest.approx(3 + 0.25 * globe.triangles + 8 * (2 + textured))


def test_triangles_that_no_ray_meets_cost_little(path):
    costs, vase = Costs(path), scene("vase")
    costs.of("rays", lambda: Rays(scene=0.0, triangle=0.5, view=0.0, ray=0.25, textured=0.0))
    few = costs.rendering("raytrace", vase, rays=100, views=3)
    looking = vase.triangles * (cost.PLACE_MS + 3 * cost.LOOK_MS)
    assert few == Stage(pytest.approx(looking + 0.5 * cost.MET * 300), 3 * 25.0, 1.0)
    many = costs.rendering("raytrace", vase, rays=vase.triangles, views=3)  # too many for culling to pay
    assert many.once == 0.5 * vase.triangles


def test_opengl_is_not_started_to_be_measured(path, monkeypatch):
    monkeypatch.setattr(backends, "_open", {})
    monkeypatch.setattr(cost.measuring, "opengl_cost", never)
    typical = Costs(path).rendering("raster", scene("vase"), rays=100, views=1)
    assert cost.OPENGL_START_MS < typical.once < cost.OPENGL_START_MS + 100
    assert 0 < typical.views < 100
    costs = Costs(path)
    costs.of("opengl", lambda: OpenGL(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0))  # another process had it open
    found = costs.rendering("raster", scene("vase"), rays=100, views=1, culls=False)
    assert found == Stage(cost.OPENGL_START_MS, 100.0, 1.0)


def test_upscaling_is_linear_and_each_model_has_its_own(path, monkeypatch):
    asked = []

    def measured(model, scale, *, is_light_field):
        asked.append((model, scale, is_light_field))
        return Network(alone=2.0, pixel=0.25, cores=1.0, of_many=1.0, pixel_of_many=0.5, cores_of_many=1.5)

    monkeypatch.setattr(cost.measuring, "network_cost", measured)
    costs = Costs(path)
    assert costs.upscaling("bicubic", 3, pixels=10, views=4) == Stage(0.0, 4 * (1 + 5), 1.5)
    for model in ("fast", "field", "fast"):
        assert costs.upscaling(model, 2, pixels=10, views=4).views == 24
        assert costs.upscaling(model, 2, pixels=10, views=1).views == 2 + 2.5
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert costs.upscaling("fast", 2, pixels=10, views=1).once == 0
    monkeypatch.delitem(sys.modules, "onnxruntime")
    assert costs.upscaling("fast", 2, pixels=10, views=1).once == cost.NETWORK_START_MS
    assert costs.upscaling("bicubic", 3, pixels=10, views=1).once == 0
    assert asked == [("bicubic", 3, False), ("fast", 2, False), ("field", 2, True)]
    assert all(len(name.split()) == 3 for name in costs._known if "bicubic" not in name)  # with the network's SHA-256


def test_encoding_is_linear(path):
    costs = Costs(path)
    costs.of("png", lambda: (1.0, 0.5))
    assert costs.encoding(pixels=10, views=4) == Stage(0.0, 24.0, 1.0)


def test_a_job_in_one_turn_takes_what_its_stages_take():
    stages = [Stage(5.0, 10.0, 1.0), Stage(2.0, 20.0, 2.0), Stage(0.0, 3.0, 1.0)]
    assert cost.together(stages, 1, 2) == 5 + 2 + 10 + 20 + 3


def test_stages_of_many_turns_overlap():
    slow, light = Stage(1.0, 100.0, 1.0), Stage(1.0, 20.0, 1.0)
    assert cost.together([slow, light], 10, 2) == pytest.approx(2 + 12 + 0.9 * 100)  # no quicker than the slowest
    assert cost.together([slow, light], 10, 1) == pytest.approx(2 + 120)  # one core has it all to do
    both = Stage(0.0, 100.0, 2.0)  # it keeps both cores busy: nothing is left for the other
    assert cost.together([both, light], 10, 2) == pytest.approx(1 + 12 + 0.9 * 110)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(
    st.lists(st.tuples(st.floats(0, 1e4), st.floats(1, 8)), min_size=1, max_size=4),
    st.integers(1, 99),
    st.integers(1, 8),
)
def test_overlap_is_between_the_slowest_stage_and_all_after_one_another(given, turns, cores):
    stages = [Stage(0.0, ms, min(busy, cores)) for ms, busy in given]
    found = cost.together(stages, turns, cores)
    one_by_one = sum(stage.views for stage in stages)
    assert max(stage.views for stage in stages) <= found + 1e-6
    assert found <= one_by_one + 1e-6  # float64: some 1e-12 of sums up to 4e4
    assert found <= cost.together(stages, max(1, turns - 1), cores) + 1e-6


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


def test_a_process_without_a_home(monkeypatch):
    for name in ("CIIR_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(cache_folder.Path, "home", homeless)
    assert cache_folder.folder() is None
