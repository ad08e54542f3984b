"""The inputs of a batch and the names of their outputs."""

from pathlib import Path

import pytest

pytest.importorskip("fsspec")

from ciir.errors import InvalidOption
from ciir.service.batch.inputs import Found, describe_textures, find_inputs, make_tasks
from ciir.service.cli.main import main


@pytest.fixture
def folder(tmp_path):
    for name in ("a.png", "b.glb", "notes.txt", ".hidden.png", "below/a.png", "film.mp4", ".batch/x.png"):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path / "in"


def find(*texts, has_arrays=True, sets=False):
    return find_inputs([str(text) for text in texts], has_arrays=has_arrays, sets=sets)[0]


def find_textures(*texts, has_arrays=True):
    return find_inputs([str(text) for text in texts], has_arrays=has_arrays, sets=False)[1]


@pytest.fixture
def meshes(tmp_path):
    """A folder of downloads: each mesh with its textures as sites pack them, and captures in a folder of their own."""
    names = [
        *("fuze/fuze.obj", "fuze/fuze.obj.mtl", "fuze/fuze.jpg", "fuze/fuze uv.jpg"),
        *("lamp/scene.gltf", "lamp/scene.bin", "lamp/textures/a.png", "lamp/textures/deep/b.TIF"),
        *("house/house.dae", "house/house/wall.jpg", "duck.glb", "captures/duck.png", "captures/b.jpg"),
    ]
    for name in names:
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path / "in"


def name_outputs(found, pattern="{path}", *, all_frames=False):
    return [task.out for task in make_tasks(found, pattern, is_file="." in pattern, all_frames=all_frames)]


def test_a_folder_stands_for_the_files_that_are_read_below_it(folder):
    found = find(folder)
    assert [each.path for each in found] == ["a.png", "b.glb", "below/a.png", "film.mp4"]
    assert found[0].source == str(folder / "a.png")
    assert name_outputs(found) == ["a", "b", "below/a", "film"]
    assert name_outputs(found, all_frames=True) == ["a", "b", "below/a", "film.mp4"]


def test_textures_of_meshes_are_no_inputs(meshes):
    captures = ["captures/b", "captures/duck"]
    found = [*captures, "duck", "fuze/fuze", "house/house", "lamp/scene"]
    assert name_outputs(find(meshes)) == found
    textures = find_textures(meshes)
    left_out = ["fuze/fuze uv.jpg", "fuze/fuze.jpg", "house/house/wall.jpg"]
    assert [each.path for each in textures] == [*left_out, "lamp/textures/a.png", "lamp/textures/deep/b.TIF"]
    (note,) = describe_textures(textures)
    assert note.startswith("5 pictures next to or below meshes are left out as textures; ")
    given = note.rpartition(" ")[2].strip("'")
    assert len(find(meshes, given)) == len(found) + 2  # what the note advises
    others = [meshes / "house" / "house", meshes / "lamp" / "textures"]
    assert describe_textures(find_textures(meshes, given, *others)) == []


def test_the_note_on_textures_escapes_names_with_characters_of_globs(meshes):
    place = meshes.rename(meshes.parent / "in [1]*")
    (note,) = describe_textures(find_textures(place))
    assert len(find(place, note.partition("such as ")[2].strip("'"))) == len(find(place)) + 2


def test_captures_next_to_meshes_that_hold_their_textures_are_inputs(meshes):
    for name in ("eia.png", "a.lfr", "b.ply", "c.stl", "d.3mf", "fuze/raw.lfr", "fuze/film.mp4"):
        (meshes / name).touch()
    assert {"eia", "a", "captures/duck", "fuze/raw", "fuze/film"} <= set(name_outputs(find(meshes)))


def test_pictures_that_are_given_are_inputs(meshes):
    texture = meshes / "fuze" / "fuze.jpg"
    for texts in ([texture], [meshes, texture], [texture, meshes], [meshes / "fuze" / "*.jpg"], [meshes / "*" / "*"]):
        assert str(texture) in [each.source for each in find(*texts)]
        assert str(texture) not in [each.source for each in find_textures(*texts)]
    assert len(find_textures(meshes, texture)) == 4
    (note,) = describe_textures(find_textures(meshes / "house"))
    assert note.startswith("1 picture next to or below a mesh is left out as textures; ")


def test_textures_are_noted_and_not_overwritten(meshes, capsys):
    assert main(["batch", str(meshes / "*"), "-o", str(meshes / "lamp" / "textures")]) == 2
    note, error = capsys.readouterr().err.splitlines()
    assert note.startswith("ciir: note: 5 pictures next to or below meshes are left out as textures; ")
    assert "the input" in error
    assert "lamp/textures/a.png is there; give another folder" in error


def test_a_set_of_views_below_a_mesh_is_an_input(meshes):
    for v, u in ((0, 0), (0, 1), (1, 0), (1, 1)):
        (meshes / "lamp" / "views").mkdir(exist_ok=True)
        (meshes / "lamp" / "views" / f"view_{v:02d}_{u:02d}.png").touch()
    assert "lamp/views" in name_outputs(find(meshes, has_arrays=False))


def test_globs_and_files(folder):
    assert name_outputs(find(folder / "*" / "*.png", folder / "a.png", folder / "a.png")) == ["below/a", "a"]
    assert name_outputs(find(f"file://{folder}/*.glb", "scene:vase"), "{number}_{name}.zip") == [
        "0001_b.glb.zip",
        "0002_vase.zip",
    ]


@pytest.mark.parametrize("pattern", ["{path}", "{stem}", "{stem}.zip"])
def test_inputs_that_differ_in_their_suffix(folder, pattern):
    """The advice is taken, and a later input changes no name."""
    (folder / "a.jpg").touch()
    with pytest.raises(InvalidOption, match="would have the same name as that of") as refused:
        name_outputs(find(folder), pattern)
    advised = str(refused.value).rpartition("give --name ")[2].strip("'")
    end = ".zip" if "zip" in pattern else ""
    assert advised == f"{{path}}_{{suffix}}{end}"
    names = [f"{name}{end}" for name in ("a_jpg", "a_png", "b_glb", "below/a_png", "film_mp4")]
    assert name_outputs(find(folder), advised) == names
    (folder / "Z.PNG").touch()
    assert name_outputs(find(folder), advised) == [f"Z_PNG{end}", *names]


def test_inputs_of_one_name_from_two_folders(folder):
    with pytest.raises(InvalidOption, match=r"give a folder that holds both, .*\{path\}.*or --name with \{number\}"):
        name_outputs(find(folder / "a.png", folder / "below" / "a.png"), "{name}")
    assert name_outputs([Found("/x", "x", is_folder=True)], "{stem}{suffix}") == ["x"]


def test_names_with_characters_of_globs_are_files(folder):
    (folder / "x[1].png").touch()
    assert name_outputs(find(folder / "x[1].png")) == ["x[1]"]


def test_a_folder_of_views_is_one_input(tmp_path):
    for v in range(2):
        for u in range(3):
            (tmp_path / "lf" / "one").mkdir(parents=True, exist_ok=True)
            (tmp_path / "lf" / "one" / f"view_{v:02d}_{u:02d}.png").touch()
    assert name_outputs(find(tmp_path / "lf", has_arrays=False)) == ["one"]
    assert name_outputs(find(tmp_path / "lf" / "one", has_arrays=False)) == ["one"]
    assert len(find(tmp_path / "lf")) == 6
    assert [each.source for each in find(tmp_path / "lf" / "*", sets=True)] == [str(tmp_path / "lf" / "one")]


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ([""], "is not a name"),
        (["absent.png"], "no such file"),
        (["*.absent"], "holds no input"),
        (["nosuch://y"], "no such kind"),
        (["github://a/b"], "doesn't say all that is needed"),
    ],
)
def test_what_is_no_input(texts, message):
    with pytest.raises(InvalidOption, match=message):
        find(*texts)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("{stem}", "would have the same name as that of"),
        ("{path.parent}", "not understood"),
        ("{absent}", "not understood"),
        ("../{path}", "is outside the folder"),
        ("/", "not understood"),
    ],
)
def test_patterns_that_are_refused(folder, pattern, message):
    with pytest.raises(InvalidOption, match=message):
        make_tasks(find(folder), pattern, is_file=False, all_frames=False)


def test_a_file_by_two_paths_is_one_input(folder):
    (folder.parent / "link").symlink_to(folder)
    names = [folder / "a.png", folder / "below" / ".." / "a.png", folder.parent / "link" / "a.png"]
    assert [each.source for each in find(*names)] == [str(folder / "a.png")]


def test_inputs_are_absolute(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert all(Path(each.source).is_absolute() for each in find("."))
