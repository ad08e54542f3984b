import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from ciir.errors import InvalidOption, Unreadable, UnsupportedType
from ciir.renderer.levels import ROUNDED
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.registry import SUFFIXES, Format
from ciir.renderer.scene import Scene
from ciir.renderer.writers.pictures import encode_png
from tests.renderer.readers.containers.test_video import make as make_video
from tests.support.inputs import CUBE, make_zip
from tests.support.light_fields import make_views
from tests.support.meshes.gltf import Model
from tests.support.paths import ROOT, SHARED

OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
PLY = (
    "ply\nformat ascii 1.0\n{}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "property float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
)
EIA = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
PNG = encode_png(EIA)


def read(files: dict[str, bytes], main: str | None = None, **options: object) -> Scene | LightField:
    return inputs.read(Bundle(main or "set", main, files), Layout(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["m.off", "m.glb", "m.ply", "m.stl"])
def test_pictures_that_a_mesh_in_one_file_does_not_use_are_noted(name: str) -> None:
    meshes = {
        "m.off": CUBE,
        "m.glb": Model().glb(),
        "m.ply": PLY.format("").encode(),
        "m.stl": b"solid\nfacet normal 0 0 1\nouter loop\n%sendloop\nendfacet\nendsolid\n"
        % b"vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n",
    }
    mesh, pictures = meshes[name], {"eia.jpg": PNG} if name == "m.ply" else {"eia.jpg": PNG, "photo.jpg": PNG}
    more = "" if name == "m.ply" else " and 1 more"
    note = f"eia.jpg{more} left out: not used by the mesh {name}"
    assert note in read({name: mesh, **pictures, "notes.txt": b""}).notes
    assert not any("left out" in note for note in read({name: mesh, **pictures}, name).notes)  # a file beside others


def test_a_texture_is_no_picture_that_is_left_out() -> None:
    textured = PLY.format("comment TextureFile Eia.PNG\n").encode()
    assert not any("left out" in note for note in read({"m.ply": textured, "eia.png": PNG}).notes)
    assert not any("left out" in note for note in read({"m.obj": OBJ, "eia.png": PNG}).notes)


@pytest.mark.parametrize("options", [{"lenses": (3, 2)}, {"pixels": (2, 4)}, {"lenses": (3, 2), "pixels": (2, 4)}])
def test_an_elemental_image_array(options: dict[str, tuple[int, int]]) -> None:
    field = read({"a.png": PNG}, "a.png", **options)
    assert field.views.shape == (2, 4, 3, 2, 3)
    assert np.array_equal(field.views[1, 2], EIA[1::2, 2::4])


def test_an_optical_pickup_turns_each_elemental_image() -> None:
    field = read({"a.png": PNG}, "a.png", lenses=(3, 2), pickup="optical")
    assert np.array_equal(field.views[0, 0], EIA[1::2, 3::4])


def test_a_picture_alone_does_not_say_how_many_lenses() -> None:
    with pytest.raises(InvalidOption, match=r"as in lenses 50x50 .* pixels 15x15"):
        read({"a.png": PNG}, "a.png")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lenses": (4, 2)}, "4x2 does not divide"),
        ({"pixels": (4, 4)}, "pixels: 4x4 does not divide"),
        ({"pixels": (0, 4)}, "pixels: 0x4 does not divide"),
        ({"lenses": (3, 4), "pixels": (2, 4)}, "3x4 lenses of 2x4 pixels do not make"),
    ],
)
def test_options_that_do_not_fit(options: dict[str, tuple[int, int]], message: str) -> None:
    with pytest.raises(InvalidOption, match=message):
        read({"a.png": PNG}, "a.png", **options)


def test_the_one_mesh_of_a_set_and_its_textures() -> None:
    files = {
        "m/a.obj": b"mtllib a.mtl\nusemtl a\n" + OBJ,
        "m/a.mtl": b"newmtl a\nKd 0 0 1\n",
        "m/x.png": PNG,
        "r.txt": b"",
    }
    scene = read(files)
    assert scene.notes == ()
    assert scene.parts[0].colors[0, 0] == 0


def test_two_meshes() -> None:
    with pytest.raises(Unreadable, match=r"holds 2 meshes \(a\.obj, b\.obj\); give one of them, or .* to `ciir batch`"):
        read({"b.obj": OBJ, "a.obj": OBJ})


def test_neither_mesh_nor_pictures() -> None:
    with pytest.raises(Unreadable, match=r"set: none of its 2 files is of a type that is read \(\.tga, \.txt\); give"):
        read({"a.txt": b"x", "b.tga": b"x"})
    with pytest.raises(Unreadable, match=r"set: holds a zip, views\.zip, which is not unpacked within .*; give a mesh"):
        read({"views.zip": b"PK\5\6"})
    with pytest.raises(Unreadable, match="set: no files in it"):
        read({})
    with pytest.raises(UnsupportedType, match="ZIP holds no mesh"):
        read({"a.zip": b"PK\5\6"}, "a.zip")


@pytest.mark.parametrize("folder", ["", "duck/"])
@pytest.mark.parametrize("textures", [1, 4])
def test_textures_beside_a_mesh_that_is_not_read_are_no_light_field(folder: str, textures: int) -> None:
    pictures = {f"{folder}textures/{number}.png": PNG for number in range(textures)}
    with pytest.raises(UnsupportedType, match=r"in a zip, .*source/model\.zip, which .*; unpack all into one fol"):
        read(pictures | {f"{folder}source/model.zip": b"PK\3\4"}, lenses=(2, 2))
    with pytest.raises(UnsupportedType, match=r"set/.*source/model\.fbx: meshes of type \.fbx are not read; export"):
        read(pictures | {f"{folder}source/model.fbx": b"Kaydara"}, lenses=(2, 2))
    assert isinstance(read(pictures | {f"{folder}source/model.obj": OBJ}), Scene)


@pytest.mark.parametrize("textures", [0, 1, 2, 4])
@pytest.mark.parametrize("options", [{}, {"lenses": (2, 2)}])
def test_a_mesh_that_is_not_read_is_named_where_textures_lie_beside_it(textures: int, options: dict[str, Any]) -> None:
    files = {"chair.fbx": b"Kaydara"} | {f"chair_{number}.png": PNG for number in range(textures)}
    end = "give them without it" if textures else r"\)"
    with pytest.raises(UnsupportedType, match=rf"^set/chair\.fbx: meshes of type \.fbx are not read; .* GLB .*{end}$"):
        read(files, **options)
    if textures < 2:
        assert isinstance(read(files | {"a.npy": make_npy()}), LightField)  # with a scene from which it was made


@pytest.mark.parametrize("folder", ["", "textures/", "source/"])
def test_a_zip_beside_an_elemental_image_array_is_left_out(folder: str) -> None:
    light_field = read({f"{folder}eia.png": PNG, "views.zip": b"PK\3\4"}, lenses=(2, 2))
    assert isinstance(light_field, LightField)
    assert "views.zip left out" in light_field.notes[-1]


def test_a_set_of_views_with_a_point_cloud_beside_it() -> None:
    picture = encode_png(np.zeros((2, 3, 3), np.uint8))
    files = {f"view_{v}_{u}.png": picture for v in range(2) for u in range(3)} | {"cloud.ply": b"ply\n"}
    field = read(files)
    assert field.views.shape == (2, 3, 2, 3, 3)


def test_reading_starts_without_what_only_some_files_need() -> None:
    heavy = "{'trimesh', 'PIL', 'DracoPy', 'OpenGL', 'embreex', 'tifffile', 'imagecodecs'}"
    code = f"import sys, ciir.renderer.readers.inputs, ciir.renderer.scenes; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)  # noqa: S603
    assert done.stdout.strip() == "[]"


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared")
@pytest.mark.parametrize("folder", ["spot", "fuze"])
def test_a_folder_and_a_zip_of_it_give_the_textured_mesh(folder: str) -> None:
    path = SHARED / "data" / "meshes" / folder
    packed = make_zip({f"top/{file.name}": file.read_bytes() for file in path.iterdir()})
    for bundle in (Bundle.from_path(path), Bundle.from_upload("a.zip", packed)):
        scene = inputs.read(bundle)
        assert scene.notes == ()
        assert [part.texture is not None for part in scene.parts] == [True]


@pytest.mark.parametrize(
    ("files", "main", "expected"),
    [
        ({"a.obj": OBJ}, "a.obj", (SUFFIXES[".obj"], "a.obj")),
        ({"a.png": PNG}, "a.png", (SUFFIXES[".png"], "a.png")),
        ({"a_cloud.ply": b"ply\n", "cube.obj": OBJ, "x.png": PNG, "y.png": PNG}, None, (SUFFIXES[".obj"], "cube.obj")),
        ({"a_cloud.ply": b"ply\n", "x.png": PNG, "y.png": PNG}, None, None),
    ],
)
def test_the_main_file(files: dict[str, bytes], main: str | None, expected: tuple[Format, str] | None) -> None:
    assert inputs.find_main(Bundle(main or "set", main, files)) == expected


def test_a_folder_of_links_to_views(tmp_path: Path) -> None:
    (tmp_path / "captures").mkdir()
    (tmp_path / "chosen").mkdir()
    for v, u in np.ndindex(2, 3):
        (tmp_path / f"captures/{v}-{u}.png").write_bytes(encode_png(np.full((2, 3, 3), 10 * v + u, np.uint8)))
        (tmp_path / f"chosen/out_0{v}_0{u}_-381.909271_{1103 + u}.376221.png").symlink_to(
            tmp_path / f"captures/{v}-{u}.png"
        )
    field = inputs.read(Bundle.from_path(tmp_path / "chosen"))
    assert isinstance(field, LightField)
    assert field.views[..., 0, 0, 0].tolist() == [[0, 1, 2], [10, 11, 12]]


VIEWS = np.random.default_rng(0).integers(0, 256, (2, 3, 4, 5, 3), np.uint8)
TILES = {"light_field.json": b"{}", "coarse.jpg": b"", "row_00.jpg": b"", "row_01.jpg": b""}


def make_npy(array: np.ndarray = VIEWS) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


@pytest.mark.parametrize("beside", [{}, {"preview.png": PNG}, {"preview.png": PNG, "notes.txt": b"x"}])
def test_a_container_in_a_folder_is_read_and_a_picture_beside_it_left_out(beside: dict[str, bytes]) -> None:
    field = read({"a.npy": make_npy(), **beside})
    assert isinstance(field, LightField)
    assert np.array_equal(field.views, VIEWS)
    assert ("preview.png left out: a.npy holds the light field" in field.notes) is bool(beside)


def test_a_container_beside_views_is_ignored() -> None:
    picture = encode_png(np.zeros((2, 3, 3), np.uint8))
    files = {f"view_{v}_{u}.png": picture for v in range(2) for u in range(3)}
    assert read(files | {"depth.h5": b"", "depth.hdf5": b"", "depth.mat": b""}).views.shape == (2, 3, 2, 3, 3)


def test_several_containers() -> None:
    for beside in ({}, {"preview.png": PNG}):
        with pytest.raises(Unreadable, match=r"holds 2 files that may be light fields \(a\.npy, b\.h5\); give one of"):
            read({"a.npy": make_npy(), "b.h5": b"", **beside})


def test_a_picture_alone_in_a_folder_is_read_as_the_picture_itself() -> None:
    for name in ("a.png", "below/a.png", "white.png"):
        field = read({name: PNG, "notes.txt": b"x"}, lenses=(3, 2))
        assert isinstance(field, LightField)
        assert np.array_equal(field.views[1, 2], EIA[1::2, 2::4])
    with pytest.raises(InvalidOption, match=r"^set/a\.png: a picture is read as an elemental image array"):
        read({"a.png": PNG})
    field = read({"a.png": PNG, "b.tga": b"?", "c.dng": b"MM", "read.txt": b"x"}, lenses=(3, 2))
    assert isinstance(field, LightField)
    assert field.notes[-1] == "b.tga and 1 more left out: a.png holds the light field"


def test_a_quilt_in_a_folder_with_its_json() -> None:
    described = b'{"viewX": 4, "viewY": 2, "aspect": 1.0}'
    field = read({"q.png": PNG, "q.png.json": described})
    assert isinstance(field, LightField)
    assert field.views.shape == (1, 8, 3, 2, 3)


def test_one_view_of_ours_stays_a_set_of_one_view() -> None:
    assert read({"view_07_07.png": PNG, "report.json": b"{}"}).views.shape == (1, 1, *EIA.shape)


@pytest.mark.parametrize("folder", ["", "below/"])
def test_tiles_are_refused_with_what_to_write_instead(folder: str) -> None:
    with pytest.raises(UnsupportedType, match="set: tiles are written for viewers and can't be read; write the light"):
        read({f"{folder}{name}": data for name, data in TILES.items()})


def test_a_video_of_elemental_image_arrays_keeps_its_order() -> None:
    """Optics give the order of an elemental image array: what seems to be wrong is noted, as in a picture."""
    views = make_views((5, 5), side=60, disparities=(-1, 1), channels=3)[::-1]
    data = make_video(np.stack([LightField(views).eia()] * 2))
    bundle = Bundle("a.mkv", "a.mkv", {"a.mkv": data})
    field = inputs.read(bundle, Layout(lenses=(60, 60)))
    assert isinstance(field, LightField)
    assert np.array_equal(field.views, views)
    (note,) = field.notes
    assert note.startswith("order: the views seem to be reversed along one axis")
    assert not inputs.holds_views(bundle, Layout(arrangement="eia"))
    assert inputs.holds_views(bundle, Layout())


@pytest.mark.parametrize(
    ("name", "format_"), [("a.mat", None), ("a.mat", "mat73"), ("a.h5", None), ("a.npz", None), ("a.tif", "stack")]
)
def test_a_container_that_is_cut_off_is_refused_without_messages_of_libraries(
    tmp_path: Path, name: str, format_: str | None
) -> None:
    path = tmp_path / name
    LightField(make_views((3, 3), side=32)).save(path, format_)
    data = path.read_bytes()
    for share in (0.5, 0.99):
        message = rf"^{name}: damaged or cut off \(.*\); send the whole file(, or give pixels .*)?$"
        with pytest.raises(Unreadable, match=message) as caught:
            inputs.read(Bundle.from_upload(name, data[: int(len(data) * share)]))
        assert not any(word in str(caught.value) for word in ("reshape", "zip file", "object", "synchronously"))


@pytest.mark.parametrize("is_set", [True, False])
def test_tiffs_of_floating_point_numbers_are_rounded_with_a_note(is_set):
    views = make_views((3, 3), side=16, channels=3)

    def save(pixels):
        file = io.BytesIO()
        tifffile.imwrite(file, pixels.astype(np.float32) / 255, photometric="rgb")
        return file.getvalue()

    eia = LightField(views).eia()
    named = {f"view_{v}_{u}.tif": save(views[v, u]) for v, u in np.ndindex(3, 3)}
    data = make_zip(named) if is_set else save(eia)
    layout = Layout(order="given") if is_set else Layout(lenses=(16, 16), arrangement="eia")
    found = inputs.read(Bundle.from_upload("a.zip" if is_set else "a.tif", data), layout)
    np.testing.assert_array_equal(found.views, views.astype(np.uint16) * 257)
    assert ROUNDED in found.notes
