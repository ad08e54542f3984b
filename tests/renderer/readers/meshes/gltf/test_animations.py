import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.errors import InvalidGeometry, InvalidOption, Unreadable
from ciir.renderer.readers.meshes.gltf.animations import slerp
from ciir.renderer.readers.meshes.pose import MeshPose
from tests.support.meshes.gltf import SQUARE, Model

STEPS = np.array([[0, 0, 0], [2, 0, 0], [2, 4, 0]], np.float32)


def shift(model: Model, time: float) -> list[float]:
    """How far the square has moved."""
    moved = model.read(MeshPose(time)).parts[0].vertices - SQUARE
    assert np.ptp(moved, axis=0) == pytest.approx(0, abs=1e-6)
    shifted: list[float] = moved[0].tolist()
    return shifted


@pytest.mark.parametrize(
    ("mode", "time", "expected"),
    [
        ("LINEAR", 0.0, [0, 0, 0]),  # before the first keyframe, which is at 1 s
        ("LINEAR", 1.5, [1, 0, 0]),
        ("LINEAR", 2.0, [2, 0, 0]),
        ("LINEAR", 3.5, [2, 3, 0]),
        ("LINEAR", 9.0, [2, 4, 0]),
        ("STEP", 1.99, [0, 0, 0]),
        ("STEP", 2.0, [2, 0, 0]),
    ],
)
def test_a_translation_between_keyframes(mode: str, time: float, expected: list[float]) -> None:
    model = Model()
    model.animate(0, "translation", [1, 2, 4], STEPS, mode)
    assert shift(model, time) == pytest.approx(expected)


def test_where_an_animation_leaves_nothing_the_time_is_named() -> None:
    model = Model()
    model.animate(0, "scale", [0, 1], np.array([[1, 1, 1], [0, 0, 0]], np.float32), "LINEAR")
    assert model.read(MeshPose(0.5)).triangles == 2
    with pytest.raises(InvalidGeometry, match=r"give a mesh with a surface, or give another time than 1\Z"):
        model.read(MeshPose(1.0))


@given(st.floats(0.0, 1.0), st.floats(-3, 3), st.floats(-3, 3))
def test_a_spline_through_two_keyframes_of_a_cubic_is_that_cubic(share: float, a: float, b: float) -> None:
    # x = a t^3 + b t^2 + t on [1, 3]: tangents are its slope, and in- and out-tangents that are not used are noise.
    value = [a * t**3 + b * t**2 + t for t in (1, 3)]
    slope = [3 * a * t**2 + 2 * b * t + 1 for t in (1, 3)]
    keys = np.array([[99, 0, 0], [value[0], 0, 0], [slope[0], 0, 0], [slope[1], 0, 0], [value[1], 0, 0], [77, 0, 0]])
    model, time = Model(), 1 + 2 * share
    model.animate(0, "translation", [1, 3], keys.astype(np.float32), "CUBICSPLINE")
    # float32 keyframes of up to 100
    assert shift(model, time)[0] == pytest.approx(a * time**3 + b * time**2 + time, abs=1e-4)


def test_rotations_go_the_shorter_way_at_constant_speed() -> None:
    angle = np.radians(100)
    first, second = np.array([0, 0, 0, 1.0]), np.array([0, 0, np.sin(angle / 2), np.cos(angle / 2)])
    for end in (second, -3 * second):
        for share in (0.0, 0.25, 1.0):
            expected = [0, 0, np.sin(share * angle / 2), np.cos(share * angle / 2)]
            assert slerp(first, end, share) == pytest.approx(expected)
    assert slerp(first, first, 0.5) == pytest.approx(first)


def test_a_rotation_of_normalised_integers() -> None:
    model = Model()
    half = round(32767 * np.sqrt(0.5))
    accessor = np.array([[0, 0, 0, 32767], [0, 0, half, half]], np.int16)
    model.animate(0, "rotation", [0, 1], accessor)
    model.json["accessors"][-1]["normalized"] = True
    (part,) = model.read(MeshPose(0.5)).parts
    # 45 degrees about z; 16 bits of the quaternion
    assert part.vertices[1] == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0], abs=1e-4)


def test_children_follow_and_nothing_moves_without_a_time() -> None:
    model = Model()
    model.json["nodes"] = [{"children": [1]}, {"mesh": 0}]
    model.animate(0, "scale", [0, 2], np.array([[1, 1, 1], [3, 3, 3]], np.float32))
    assert model.read(MeshPose(1.0)).bounds().tolist() == [[0, 0, 0], [2, 2, 0]]
    assert model.read().bounds().tolist() == [[0, 0, 0], [1, 1, 0]]


def test_animations_of_other_properties_are_played_together() -> None:
    model = Model()
    model.animate(0, "translation", [0, 1], STEPS[:2])
    model.json["animations"].append({"name": "Jump", "channels": [], "samplers": []})
    model.animate(0, "translation", [0, 1], STEPS[1:])
    model.json["animations"].append({"channels": [], "samplers": []})
    model.animate(0, "scale", [0, 1], np.full((2, 3), 2, np.float32))
    scene = model.read(MeshPose(1.0))
    assert scene.bounds().tolist() == [[2, 0, 0], [4, 2, 0]]
    note = "animation: the first is played; others that move the same nodes are not (Jump); animation selects one"
    assert scene.notes == (note,)
    for name in ("Jump", "1"):
        jumped = model.read(MeshPose(1.0, animation=name))
        assert jumped.bounds().tolist() == [[2, 4, 0], [3, 5, 0]]  # that one alone
        assert jumped.notes == ()
    with pytest.raises(InvalidOption, match=r"animation: '7' is not in a\.glb; give 0, 1 \(Jump\), 2$"):
        model.read(MeshPose(1.0, animation="7"))


def test_a_samplers_number_and_interpolation_are_checked() -> None:
    model = Model()
    model.animate(0, "translation", [0, 1], STEPS[:2], "CUBIC")
    assert model.read(MeshPose(0.5)).notes == ("animation: interpolation CUBIC is read as LINEAR",)
    model.json["animations"][0]["channels"][0]["sampler"] = -1
    with pytest.raises(Unreadable, match="an animation's sampler is number -1"):
        model.read(MeshPose(0.5))


def test_a_time_behind_the_end_is_noted_and_one_without_animations_refused() -> None:
    model = Model()
    with pytest.raises(InvalidOption, match=r"time: a\.glb holds no animation; leave it out"):
        model.read(MeshPose(1.0))
    model.animate(0, "translation", [0, 2], STEPS[:2])
    assert model.read(MeshPose(2.0)).notes == ()
    assert model.read(MeshPose(2.5)).notes == ("time: the animation ends at 2 s; its last pose is shown",)


def test_what_can_not_be_played() -> None:
    model = Model()
    model.animate(0, "translation", [0, 1], STEPS[:2])
    model.json["animations"][0]["channels"].append({"sampler": 0, "target": {"path": "pointer"}})
    assert "animations of anything other than nodes are not played" in model.read(MeshPose(0.5)).notes
    for times, values, path, message in (
        ([0, 1], STEPS, "translation", "keyframes and values don't fit"),
        ([np.nan, 1], STEPS[:2], "translation", "keyframes and values don't fit"),
        ([0, 1], STEPS[:2], "rotation", "an animated rotation has 3 numbers"),
    ):
        broken = Model()
        broken.animate(0, path, times, values)
        with pytest.raises(Unreadable, match=message):
            broken.read(MeshPose(0.5))
