"""Displays for tests: a small lenticular one, and scenes placed at a display."""

import json

import pytest

from ciir.renderer.displays.lenticular import parse_calibration
from ciir.renderer.framing import frame_scene
from ciir.renderer.placement import Placement
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.scenes import SCENES, load_scene
from tests.support.paths import SHARED

CALIBRATION = {
    "serial": "TEST",
    "pitch": {"value": 47.3},
    "slope": {"value": 5.8},
    "center": {"value": 0.31},
    "viewCone": {"value": 40.0},
    "invView": {"value": 0},
    "DPI": {"value": 338.0},
    "screenW": {"value": 120.0},
    "screenH": {"value": 80.0},
    "flipImageX": {"value": 0.0},
    "flipImageY": {"value": 0.0},
    "flipSubp": {"value": 0.0},
}


def make_calibration(**values):
    """Makes the calibration of a display of 120x80 pixels with the other numbers of a real one, some replaced by
    `values`.
    """
    changed = {key: {"value": value} for key, value in values.items()}
    return parse_calibration(json.dumps(CALIBRATION | changed).encode(), name="c.json")


def load_at(name, array):
    """Loads a sample scene, or a mesh of ../shared, half behind and half in front of `array`. Skips the test if
    ../shared is missing.
    """
    if name in SCENES:
        scene = load_scene(name)
    elif SHARED.is_dir():
        scene = read(Bundle.from_path(SHARED / "data" / "meshes" / name))
    else:
        pytest.skip("needs ../shared")
    return scene.transform(frame_scene(scene, array, Placement(place=0)))
