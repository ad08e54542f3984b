import json
import random
import struct
from collections.abc import Mapping

import numpy as np
import pytest
import trimesh

from ciir.errors import InputError, InvalidOption, TooLarge
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.renderer.readers import meshes
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.meshes import UPRIGHT, trimesh_formats
from ciir.renderer.readers.meshes.pose import MeshPose
from ciir.renderer.readers.registry import SUFFIXES, Format, identify
from ciir.renderer.scene import Scene
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.source import Input
from tests.support.meshes import read_mesh
from tests.support.paths import SHARED

MESHES = SHARED / "data" / "meshes"
PICTURE = encode_png(np.full((4, 4, 3), 128, np.uint8))


def textured_glb() -> bytes:
    mesh = trimesh.creation.box()
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=mesh.vertices[:, :2] + 0.5,
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[200, 100, 50, 255]),
    )
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def samples() -> dict[Format, tuple[bytes, dict[str, bytes]]]:
    """A small file of each kind, and what it refers to."""
    box = trimesh.creation.box()
    box.visual.vertex_colors = np.arange(32, dtype=np.uint8).reshape(8, 4)
    obj = (
        b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl m\n"
        b"f 1/1/1 2/2/1 3/3/1\nf -4/1/1 -2/3/1 -1/2/1\n"
    )
    return {
        SUFFIXES[".glb"]: (textured_glb(), {}),
        SUFFIXES[".gltf"]: (
            json.dumps(
                {
                    "asset": {"version": "2.0"},
                    "scenes": [{"nodes": [0]}],
                    "nodes": [{"mesh": 0, "rotation": [0, 0, 0, 1], "scale": [1, 2, 1]}],
                    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
                    "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.25, 1]}}],
                    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
                    "bufferViews": [{"buffer": 0, "byteLength": 36}],
                    "buffers": [{"uri": "a.bin", "byteLength": 36}],
                }
            ).encode(),
            {"a.bin": struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)},
        ),
        SUFFIXES[".obj"]: (obj, {"a.mtl": b"newmtl m\nKd 1 0.5 0\nmap_Kd -s 1 1 1 x.png\n", "x.png": PICTURE}),
        SUFFIXES[".ply"]: (box.export(file_type="ply"), {}),
        SUFFIXES[".stl"]: (box.export(file_type="stl"), {}),
        SUFFIXES[".off"]: (box.export(file_type="off").encode(), {}),
        SUFFIXES[".dae"]: (box.export(file_type="dae"), {}),
    }


SAMPLES = samples()
ASCII = {
    SUFFIXES[".ply"]: trimesh.creation.box().export(file_type="ply", encoding="ascii"),
    SUFFIXES[".stl"]: trimesh.creation.box().export(file_type="stl_ascii").encode(),
}


def read(data: bytes, kind: Format, files: Mapping[str, bytes], limits: Limits = DEFAULT_LIMITS) -> Scene:
    main = f"main.{kind.extension}"
    return meshes.read(Bundle(main, main, {main: data, **files}, limits), main, kind)


@pytest.mark.parametrize("kind", SAMPLES)
def test_every_kind_is_read(kind: Format) -> None:
    data, files = SAMPLES[kind]
    scene = read(data, kind, files)
    assert scene.triangles > 0
    assert scene.notes == ((UPRIGHT,) if kind.name == "STL" else ())
    assert identify(f"a.{kind.extension}", data) is kind


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        (".dae", {}),
        (".ply", {"encoding": "ascii"}),
        (".ply", {"encoding": "binary"}),
        (".off", {}),
        (".stl", {}),
        (".3mf", {}),
    ],
)
def test_what_trimesh_writes(suffix: str, options: dict[str, str]) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    data = mesh.export(file_type=suffix[1:], **options)
    scene = read_mesh(suffix, data if isinstance(data, bytes) else data.encode())
    assert scene.triangles == len(mesh.faces)
    assert scene.bounds() == pytest.approx(mesh.bounds, abs=1e-6)


@pytest.mark.parametrize("kind", SAMPLES)
def test_too_many_triangles(kind: Format) -> None:
    data, files = SAMPLES[kind]
    with pytest.raises(TooLarge, match="; decimate the mesh"):
        read(data, kind, files, Limits(triangles=0))


@pytest.mark.parametrize("kind", SAMPLES)
def test_another_kinds_bytes_are_refused_in_one_line(kind: Format) -> None:
    for other, (data, files) in SAMPLES.items():
        if other is not kind and {kind, other} != {SUFFIXES[".glb"], SUFFIXES[".gltf"]}:
            with pytest.raises(InputError) as caught:
                read(data, kind, files)
            assert "\n" not in str(caught.value)


CASES = [(kind, *SAMPLES[kind]) for kind in SAMPLES] + [(kind, data, {}) for kind, data in ASCII.items()]


@pytest.mark.parametrize(
    ("kind", "data", "files"), CASES, ids=lambda value: value.name if isinstance(value, Format) else ""
)
def test_hostile_bytes_end_in_a_scene_or_in_one_line(
    kind: Format, data: bytes, files: dict[str, bytes], capfd: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(kind.extension)  # noqa: S311 - the same each time is the point
    tokens = b'nan|-1|1e999|99999999999999999999|\0|{}|[]|"x"|null|true|\n| |\xff\xff\xff\xff|\x7f|/|..|0'.split(b"|")
    messages = []
    for _ in range(300):
        broken = bytearray(data)
        for _ in range(rng.choice((1, 1, 2, 6))):
            at = rng.randrange(len(broken))
            match rng.randrange(4):
                case 0:
                    broken[at] ^= 1 << rng.randrange(8)
                case 1:
                    del broken[at:]
                    broken += b" "
                case 2:
                    broken[at : at + rng.randrange(8)] = rng.choice(tokens)
                case _:
                    del broken[at : at + rng.randrange(1, 30)]
                    broken += b" "
        other_files = {name: content[: rng.randrange(len(content) + 1)] for name, content in files.items()}
        try:
            scene = read(bytes(broken), kind, rng.choice((files, other_files)))
        except InputError as error:
            messages.append(str(error))
        else:
            assert np.isfinite(scene.bounds()).all()
            for part in scene.parts:
                assert part.faces.min() >= 0
                assert part.faces.max() < len(part.vertices)
                assert part.colors.shape == (len(part.vertices), 4)
                assert part.uv is None or np.isfinite(part.uv).all()
                assert part.colors.min() >= 0
                assert part.colors.max() <= 1
    assert messages
    assert not [message for message in messages if "\n" in message or len(message) > 400]
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared")
@pytest.mark.parametrize(
    ("name", "triangles", "low", "high", "texture"),
    [
        ("boot.obj", 39906, (-0.1368, -0.0001, -0.0540), (0.1702, 0.2022, 0.0563), None),
        ("bust-draco.glb", 176094, (-1.9294, 0.0233, -1.8662), (1.8834, 6.4048, 2.9652), None),
        ("duck.glb", 4212, (-0.6930, 0.0993, -0.6133), (0.9618, 1.6397, 0.5393), (512, 512, 4)),
        ("earth.gltf", 1640, (-1.0545, -0.9772, -1.2176), (1.1918, 1.0483, 1.0508), None),
        ("fuze/fuze.obj", 1000, (-0.0364, -0.0367, 0.0040), (0.0362, 0.0368, 0.2191), (1024, 1024, 4)),
        ("koala.obj", 99994, (-1.8908, -1.4361, -4.2249), (1.8907, 3.9303, 5.0455), None),
        ("milk-truck.glb", 3624, (-2.4309, 0.0015, -1.3960), (2.4380, 2.5844, 1.3960), (2048, 2048, 4)),
        ("skull.obj", 10312, (-4.3957, -0.0071, -5.6222), (4.2919, 13.9008, 6.4896), None),
        ("spot/spot.obj", 5856, (-0.4716, -0.7368, -0.6689), (0.4716, 0.9536, 1.0490), (1024, 1024, 4)),
    ],
)
def test_real_files(
    name: str, triangles: int, low: tuple[float, ...], high: tuple[float, ...], texture: tuple[int, ...] | None
) -> None:
    bundle = Bundle.from_path(MESHES / name)
    scene = meshes.read(bundle, bundle.name, identify(bundle.name, bundle.files[bundle.name]))
    assert scene.triangles == triangles
    assert scene.bounds() == pytest.approx(np.array([low, high]), abs=1e-4)
    assert [part.texture.pixels.shape for part in scene.parts if part.texture] == ([texture] if texture else [])


def test_memory_that_runs_out_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*args: object, **more: object) -> None:
        raise MemoryError

    for owner, name in ((trimesh_formats, "read_off"), (meshes, "assemble_scene")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, full)
            with pytest.raises(TooLarge, match="more memory than there is; decimate"):
                read(SAMPLES[SUFFIXES[".off"]][0], SUFFIXES[".off"], {})


@pytest.mark.parametrize("pose", [MeshPose(time=1.0), MeshPose(camera="0")])
def test_poses_are_for_formats_that_have_them(pose: MeshPose) -> None:
    off = SUFFIXES[".off"]
    with pytest.raises(
        InvalidOption, match=r"time, animation, camera: these apply only to glTF files, and a\.off is OFF; leave"
    ):
        read_mesh(".off", SAMPLES[off][0], pose=pose)
    with pytest.raises(InvalidOption, match="time, animation, camera: scene:vase holds no animations and no cameras"):
        Input("vase").read(Options(time=None if pose.time is None else (pose.time,), camera=pose.camera))


def test_a_camera_has_an_up_of_its_own() -> None:
    with pytest.raises(InvalidOption, match="up, camera: a camera has its own up direction; leave one of them out"):
        Input("vase").read(Options(up="z", camera="0"))


def test_a_cameras_picture_is_always_fitted() -> None:
    with pytest.raises(InvalidOption, match="fit, camera: what a camera sees is fitted into the centre view; leave"):
        Input("vase").read(Options(fit="none", camera="0"))


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared")
def test_the_wheels_of_a_real_truck_turn_and_a_real_camera_looks_down() -> None:
    truck = (MESHES / "milk-truck.glb").read_bytes()
    still, turned = (read_mesh(".glb", truck, pose=MeshPose(time)) for time in (None, 0.3125))
    assert turned.bounds() == pytest.approx(still.bounds(), abs=0.01)  # wheels are polygons
    moved = np.concatenate(
        [np.abs(a.vertices - b.vertices).max(axis=1) > 1e-3 for a, b in zip(still.parts, turned.parts, strict=True)]
    )
    assert 0.1 < moved.mean() < 0.9  # the wheels, and not the rest
    duck = (MESHES / "duck.glb").read_bytes()
    tipped = read_mesh(".glb", duck, pose=MeshPose(camera="0"))
    assert not np.allclose(tipped.bounds(), read_mesh(".glb", duck).bounds(), atol=0.01)
