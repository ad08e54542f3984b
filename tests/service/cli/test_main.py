import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from ciir.renderer.writers.pictures import encode
from ciir.service.cli.main import main
from ciir.service.settings import Settings
from tests.support.cli import SMALL, fails, read
from tests.support.inputs import BAD_INPUTS, contains_all, make_picture
from tests.support.light_fields import make_views, write_views
from tests.support.servers import run_python


def test_reconstruct_a_mesh(cube_file, tmp_path, capsys):
    out, report = tmp_path / "out", tmp_path / "r.json"
    argv = ["reconstruct", str(cube_file), "-o", str(out), "--views", "cross", "--model", "bicubic", *SMALL]
    assert main([*argv, "--report", str(report)]) == 0
    names = sorted(path.name for path in out.iterdir())
    assert names == ["report.json"] + [f"view_{v:02d}_{u:02d}.png" for v, u in [(0, 2), (1, 0), (1, 2), (1, 4), (2, 2)]]
    assert read(out / "view_01_02.png").shape == (24, 20, 3)
    assert json.loads((out / "report.json").read_text()) == json.loads(report.read_text())
    assert "5 views of 24x20" in capsys.readouterr().out


def test_reconstruct_into_one_file(cube_file, tmp_path):
    argv = ["reconstruct", str(cube_file), "--model", "none", *SMALL]
    assert main([*argv, "-o", str(tmp_path / "a.png")]) == 0
    assert main([*argv, "-o", str(tmp_path / "a.npz"), "--views", "all"]) == 0
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays["views"].shape == (15, 12, 10, 3)
        assert np.array_equal(arrays["views"][7], read(tmp_path / "a.png"))


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
def test_elemental(cube_file, tmp_path, suffix):
    out, report = tmp_path / f"eia{suffix}", tmp_path / "r.json"
    assert main(["elemental", str(cube_file), "-o", str(out), "--report", str(report), *SMALL]) == 0
    assert read(out).shape == (36, 50, 3)
    assert json.loads(report.read_text())["lens_array"]["pixels_u"] == 5


@pytest.mark.parametrize("bad_input", BAD_INPUTS.values(), ids=BAD_INPUTS)
def test_bad_input_is_one_line_and_leaves_nothing(bad_input, tmp_path, capsys):
    name, data, texts, _, words = bad_input
    (tmp_path / name).write_bytes(data)
    options = [word for option, text in texts.items() for word in (f"--{option}", text)]
    line = fails(capsys, "reconstruct", tmp_path / name, "-o", tmp_path / "out", *options)
    assert contains_all(line, words), line
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ([], ["--help"]),
        (["--foo"], ["--foo; see ciir --help"]),
        (["nothing"], ["nothing", "reconstruct", "; see ciir --help"]),
        (["reconstrct", "x"], ["'reconstrct'", "; did you mean reconstruct?"]),
        (["bench", "--only", "mesh"], ["--only", "'mesh'", "; did you mean meshes?"]),
        (["reconstruct"], ["INPUT", "-o"]),
        (["reconstruct", "gone.glb", "-o", "out"], ["gone.glb"]),
        (["reconstruct", "scene:teapot", "-o", "out"], ["teapot", "hamburger"]),
        (["reconstruct", "scene:vase", "-o", "out", "--len", "5x5"], ["--len"]),
        (["reconstruct", "scene:vase", "-o", __file__, "--model", "none"], ["as .py"]),
        (
            ["reconstruct", "scene:vase", "--views", "cross", "-o", "a.png"],
            ["give a folder (a name without a suffix), zip or npz, or one view"],
        ),
        (["elemental", "scene:vase", "-o", "eia.gif"], ["eia.gif", ".png"]),
        (["elemental", "scene:vase", "-o", "eia.obj"], [".jpeg, .webp\n"]),
        (["elemental", "scene:vase", "-o", "eia.mat/"], [".jpeg, .webp\n"]),
        (
            ["elemental", "scene:vase", "-o", "eia.mat"],
            [".webp, or use `ciir convert`, which writes all views as .mat"],
        ),
        (["elemental", "scene:vase", "-o", "eia.jpg", "--model", "paper"], ["--model"]),
        (["serve", "--port", "many"], ["port", "65535"]),
        (["reconstruct", "scene:vase", "-o", "out", "--lenses", "-5x5"], ["lenses: '-5x5'", "100x100"]),
        (["reconstruct", "scene:vase", "-o", "out", "--views", "-1,0"], ["views: '-1,0'", "center"]),
        (["reconstruct", "scene:vase", "-o", "out", "--delta", "-1e-3"], ["delta: -0.001", "positive"]),
        (["reconstruct", "scene:vase", "--views", "-o", "out"], ["--views", "expected one argument"]),
        (["reconstruct", "scene:vase", "-o", "o" * 300], ["too long", "name a place"]),
        (["evaluate"], ["MODEL", "--light-field"]),
        (["evaluate", "fast"], ["MODEL", "--light-field"]),
        (["evaluate", "fast", "--foo", "a"], ["unrecognized", "--foo", "see ciir evaluate --help"]),
        (
            ["reconstruct", "a", "-o", "b", "--views", "0,0", "7,7"],
            ["unrecognized", "7,7; several views", "--views '0,0 7,7'"],
        ),
        (["reconstruct", "scene:vase", "--lens", "5x5", "-o", "a.png"], ["--lens 5x5; did you mean --lenses?"]),
        (["evaluate", "--light-feild", "a"], ["--light-feild; did you mean --light-field?"]),
        (["models", "--lens", "5x5"], ["--lens 5x5; see ciir models --help"]),
        (["evaluate", "fast", "a", "--grid", "5x5"], ["--grid", "--light-field"]),
        (["evaluate", "--light-field", "gone"], ["gone", "no such folder", "views"]),
        (["evaluate", "--light-field", ".", "--grid", "5"], ["grid: '5'", "rows x columns"]),
        (["evaluate", "--light-field", ".", "fast", "a"], ["'a'", "give one of best, best-int8, fast, fast-int8"]),
        (["evaluate", "--light-field", ".", "fast", "."], ["'.'", "give one of them"]),
        (["evaluate", "--light-field", ".", "--json", "."], ["a folder is there"]),
        (["evaluate", "fast", "a", "--pixels", "5x5"], ["--pixels", "--light-field"]),
        (["train", "gone.toml", "-o", "run"], ["gone.toml"]),
        (["export", "gone.pt", "-o", "card"], ["gone.pt"]),
        (["export", "--weights", "gone.pth", "-o", "card"], ["gone.pth", "the weights"]),
        (["export", "-o", "card"], ["CHECKPOINT", "--weights"]),
        (["export", "a.pt", "--weights", "b.pth", "-o", "card"], ["one of them"]),
        (["export", "a.pt", "--int8", "-o", "card"], ["--calibrate"]),
        (["export", "a.pt", "--calibrate", ".", "-o", "card"], ["--int8"]),
        (["export", "--weights", "b.pth", "--int8", "--calibrate", ".", "-o", "card"], ["--int8", "CHECKPOINT"]),
    ],
)
def test_bad_arguments_are_one_line(argv, words, capsys, empty_folder):
    line = fails(capsys, *argv)
    assert contains_all(line, words), line
    assert list(empty_folder.iterdir()) == []


def test_an_old_result_survives_an_error(eia_file, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(b"old")
    fails(capsys, "reconstruct", eia_file, "--lenses", "6x9", "--views", "all", "-o", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "eia.png"]


CIIR = ("-m", "ciir")


def test_as_a_process(cube_file, tmp_path):
    done = run_python(*CIIR, "reconstruct", cube_file, "-o", tmp_path / "out", "--model", "none", *SMALL)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("\n") == 1
    failed = run_python(*CIIR, "reconstruct", cube_file, "-o", tmp_path / "out2", "--scale", "0")
    assert (failed.returncode, failed.stdout, failed.stderr.count("\n")) == (2, "", 1)
    assert not (tmp_path / "out2").exists()


def test_nothing_heavy_is_imported_before_it_is_needed():
    script = (
        "import sys; from ciir.service.cli.main import main; main(['models']); "
        "heavy = {'trimesh', 'OpenGL', 'onnxruntime', 'PIL', 'scipy', 'fastapi', 'torch'} & set(sys.modules); "
        "sys.exit(','.join(heavy) or 0)"
    )
    done = run_python("-c", script)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_closed_pipe_is_quiet():
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as output:
        done = run_python(*CIIR, "models", "--json", stdout=output)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("argv", [["models"], ["--version"], ["--help"]])
def test_no_room_for_the_output_is_one_line(argv):
    with Path("/dev/full").open("w") as output:
        done = run_python(*CIIR, *argv, stdout=output)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "No space left" in done.stderr


def test_version(capsys):
    from importlib.metadata import version

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"ciir {version('ciir')}\n"


def test_notes_are_printed(tmp_path, capsys):
    (tmp_path / "a.obj").write_bytes(b"mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    for command in ("reconstruct", "elemental"):
        small = SMALL + ["--model", "none"] * (command == "reconstruct")
        assert main([command, str(tmp_path / "a.obj"), "-o", str(tmp_path / "a.png"), *small]) == 0
        lines = capsys.readouterr().err.splitlines()
        assert [line for line in lines if line.startswith("ciir: note: ") and "gone.mtl" in line]


def test_views_in_a_wrong_order_are_put_right_with_a_note(tmp_path, capsys):
    views = make_views(channels=3)
    (tmp_path / "views").mkdir()
    for name, data in write_views(views, lambda v, u: f"{u}_{v}.png").items():
        (tmp_path / "views" / name).write_bytes(data)
    for options, is_noted in (([], True), (["--order", "given"], False)):
        argv = [str(tmp_path / "views"), "-o", str(tmp_path / "out.npz"), "--views", "0,4", "--model", "none", *options]
        assert main(["reconstruct", *argv]) == 0
        note = "ciir: note: --order: 5x5 views, rows x columns: in 0_4.png 0 is the column and 4 the row, which fits"
        assert capsys.readouterr().err.startswith(note) == is_noted
        written = np.load(tmp_path / "out.npz")["views"][0]
        assert np.array_equal(written, views[0, 4] if is_noted else views[4, 0])


def test_interrupting_is_quiet(monkeypatch, capsys, tmp_path):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ciir.service.pipeline.run.reconstruct", interrupt)
    assert main(["reconstruct", "scene:vase", "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == "ciir: interrupted\n"
    assert list(tmp_path.iterdir()) == []


def test_output_over_the_input_is_refused(tmp_path, capsys):
    (tmp_path / "pics").mkdir()
    picture = tmp_path / "pics" / "a.png"
    picture.write_bytes(encode(make_picture(4, 4), ".png"))
    before = picture.read_bytes()
    for argv in (
        ["upscale", str(tmp_path / "pics"), "-o", str(tmp_path / "pics") + "/"],
        ["upscale", str(picture), "-o", str(picture)],
        ["reconstruct", str(tmp_path / "pics"), "-o", str(tmp_path / "pics")],
        ["reconstruct", str(tmp_path / "pics"), "-o", str(tmp_path / "pics" / "sub")],
        ["upscale", str(picture), "-o", str(tmp_path / "pics"), "--model", "nearest"],
        ["upscale", str(picture), "-o", str(tmp_path / "b.png"), "--report", str(picture)],
        ["upscale", str(tmp_path / "pics"), "-o", str(tmp_path / "out"), "--report", str(picture)],
        ["elemental", str(picture), "-o", str(picture)],
    ):
        assert "the input is there" in fails(capsys, *argv)
    assert picture.read_bytes() == before
    view, link = tmp_path / "view_00_00.png", tmp_path / "link.png"
    picture.rename(view)
    link.symlink_to(view)
    common = ["--pixels", "2x2", "--model", "none"]
    assert "the input is there" in fails(capsys, "reconstruct", view, *common, "--views", "all", "-o", tmp_path)
    assert "the input is there" in fails(capsys, "reconstruct", view, *common, "-o", link)
    assert view.read_bytes() == before
    assert "'' is not a name" in fails(capsys, "reconstruct", "", "-o", tmp_path / "out")


@pytest.mark.parametrize(
    "command",
    [
        "reconstruct",
        "convert",
        "elemental",
        "upscale",
        "models",
        "bench",
        "stress",
        "evaluate",
        "train",
        "export",
        "serve",
    ],
)
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit) as stop:
        main([command, "--help"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: ciir {command}")


def test_help_names_settings_that_exist(capsys):
    with pytest.raises(SystemExit):
        main(["serve", "--help"])
    named = set(re.findall(r"CIIR_([A-Z_]+)", capsys.readouterr().out)) - {""}
    assert {"FOLDER", "KEEP_SECONDS"} <= named <= {name.upper() for name in Settings.model_fields}


@pytest.mark.parametrize(
    ("command", "is_video"),
    [
        ("reconstruct", True),
        ("batch", True),
        ("elemental", False),
        ("convert", False),
        ("refocus", False),
        ("depth", False),
    ],
)
def test_help_says_of_several_poses_only_what_the_command_makes_of_them(capsys, command, is_video):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    printed = " ".join(capsys.readouterr().out.split())
    assert "time in a glTF mesh's animation (default: the mesh as it is stored)" in printed
    assert printed.count("make a video of one view") == 2 * is_video
