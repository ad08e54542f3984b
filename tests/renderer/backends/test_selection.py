"""Which backend is taken, and why."""

import subprocess
import sys

import pytest

from ciir.errors import BackendUnavailable, InvalidOption
from ciir.renderer.backends import open_backend, predict_backend, selection
from tests.support.backends import require_backend


@pytest.fixture
def no_opengl(monkeypatch):
    monkeypatch.delitem(selection._open, "raster", raising=False)
    monkeypatch.setitem(selection._refused, "raster", "raster: no display")


@pytest.mark.usefixtures("no_opengl")
def test_a_refusal_keeps_no_caller_alive():
    raised = []
    for _ in range(2):
        with pytest.raises(BackendUnavailable, match="no display") as caught:
            open_backend("raster")
        raised.append(caught.value)
    assert raised[0] is not raised[1]


@pytest.mark.usefixtures("no_opengl")
def test_auto_names_its_reason():
    made, reason = open_backend("auto", triangles=1, rays=1 << 20)
    assert made.name == "raytrace"
    assert predict_backend("auto", triangles=1, rays=1 << 20) == "raster"  # which every machine plans with
    assert "no display" in reason


def test_auto_casts_rays_where_materials_are_see_through():
    made, reason = open_backend("auto", triangles=1, rays=1 << 20, is_see_through=True)
    assert made.name == predict_backend("auto", triangles=1, rays=1 << 20, is_see_through=True) == "raytrace"
    assert "see-through" in reason
    assert predict_backend("raster", triangles=1, rays=1, is_see_through=True) == "raster"


def test_auto_counts_rays_and_triangles():
    require_backend("raster")
    few = selection.FEW_RAYS
    for triangles, rays, expected in (
        (10, few, "raytrace"),
        (10, few + 1, "raster"),
        (10 * few, 10 * few, "raytrace"),
        (10 * few, 10 * few + 1, "raster"),
    ):
        made, reason = open_backend("auto", triangles=triangles, rays=rays)
        assert made.name == predict_backend("auto", triangles=triangles, rays=rays) == expected
        assert f"{rays:,} rays" in reason


def test_unknown_backend():
    with pytest.raises(InvalidOption, match="auto, raster or raytrace"):
        open_backend("vulkan")


FORKING = """
import os, sys
from ciir.errors import BackendUnavailable
from ciir.renderer.backends import open_backend
rays = {"triangles": 1, "rays": 1 << 20}
assert open_backend("auto", **rays)[0].name == "raster"
child = os.fork()
if child:
    _, status = os.waitpid(child, 0)
    assert open_backend("auto", **rays)[0].name == "raster"
    sys.exit(os.waitstatus_to_exitcode(status))
made, reason = open_backend("auto", **rays)
print(made.name, reason, flush=True)
try:
    open_backend("raster")
except BackendUnavailable as error:
    print(error, flush=True)
os._exit(0)
"""


def test_opengl_is_refused_in_a_process_that_was_forked_after_its_start():
    require_backend("raster")
    done = subprocess.run([sys.executable, "-c", FORKING], capture_output=True, text=True, timeout=60, check=True)  # noqa: S603 - our own code
    automatic, asked = done.stdout.splitlines()
    assert automatic.startswith("raytrace raytrace: ")
    assert asked.startswith("OpenGL was started before this process was forked")
    assert "spawn" in automatic
