import dataclasses
import json
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ciir import models
from ciir.models.cards import Accuracy
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from ciir.service.cli.main import main
from ciir.service.settings import Settings
from tests.support.inputs import BAD_INPUTS, EIA, contains_all, make_picture
from tests.support.light_fields import make_views, write_views
from tests.support.paths import ROOT
from tests.support.servers import run_python

SMALL = ["--lenses", "12x10", "--pixels", "3x5", "--backend", "raytrace"]


def read(path):
    return decode(Path(path).read_bytes(), name=str(path))


def fails(capsys, *argv):
    """The one line on standard error of a command that ends with 2."""
    assert main([str(word) for word in argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("ciir: ")
    assert captured.err.count("\n") == 1
    return captured.err


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


def test_upscale_a_picture(tmp_path):
    picture = make_picture(5, 6, 2, np.uint16)
    (tmp_path / "a.png").write_bytes(encode(picture, ".png"))
    argv = ["upscale", str(tmp_path / "a.png"), "--model", "bicubic", "--scale", "3"]
    assert main([*argv, "-o", str(tmp_path / "b.tif"), "--report", str(tmp_path / "r.json")]) == 0
    expected = models.upscale_pixels(models.load_upscaler("bicubic", scale=3), picture[np.newaxis])[0]
    assert np.array_equal(read(tmp_path / "b.tif"), expected)
    assert json.loads((tmp_path / "r.json").read_text())["pictures"][0]["file"] == "b.tif"
    assert main([*argv, "-o", str(tmp_path / "folder")]) == 0
    assert np.array_equal(read(tmp_path / "folder" / "a.png"), expected)


def test_upscale_a_folder(tmp_path, capsys):
    source, out = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    (source / "a.png").write_bytes(encode(make_picture(5, 6), ".png"))
    (source / "b.jpg").write_bytes(encode(make_picture(4, 4), ".jpg"))
    (source / "notes.txt").write_text("hello")
    argv = ["upscale", str(source), "-o", str(out), "--model", "nearest", "--report", str(tmp_path / "r.json")]
    assert main(argv) == 0
    assert sorted(path.name for path in out.iterdir()) == ["a.png", "b.png"]
    (note,) = json.loads((tmp_path / "r.json").read_text())["notes"]
    assert "notes.txt" in note
    assert capsys.readouterr().err == f"ciir: note: {note}\n"


def test_upscale_leaves_nothing_where_one_picture_is_bad(tmp_path, capsys):
    source, out = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    (source / "a.png").write_bytes(encode(EIA, ".png"))
    (source / "b.png").write_bytes(encode(EIA, ".png")[:100])
    assert "b.png" in fails(capsys, "upscale", source, "-o", out, "--model", "nearest")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_models(capsys):
    assert main(["models"]) == 0
    text = capsys.readouterr().out
    assert main(["models", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [model["name"] for model in listed] == models.list_names()
    assert all(model["name"] in text for model in listed)
    assert [model["name"] for model in listed if model["default"]] == [models.default_name()]
    assert [model["name"] for model in listed if model["takes"] != "a picture"] == ["field", "field-int8"]
    assert "model auto, what `ciir reconstruct` does where none is named: field for views of a grid" in text


def test_upscale_takes_no_light_field_network(stand_in, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encode(make_picture(5, 6), ".png"))
    line = fails(capsys, "upscale", tmp_path / "a.png", "-o", tmp_path / "b.png", "--model", "field")
    assert contains_all(line, ["model field", "ciir reconstruct", "fast"])
    assert "`ciir reconstruct`" in fails(capsys, "upscale", "scene:vase", "-o", tmp_path / "b.png")
    assert "`ciir convert` makes pictures of its views" in fails(capsys, "upscale", "a.npy", "-o", tmp_path / "b.png")
    assert main(["upscale", str(tmp_path / "a.png"), "-o", str(tmp_path / "b.png")]) == 0


def test_models_says_which_are_not_for_this_machine(capsys, monkeypatch):
    entries = [
        dataclasses.replace(
            entry, card=entry.card and dataclasses.replace(entry.card, precision="int8", float_twin="slow")
        )
        for entry in models.list_entries()
    ]
    monkeypatch.setattr(models.catalogue, "list_entries", lambda: entries)
    monkeypatch.setattr(models.catalogue.processor, "int8_unsupported_reason", lambda: "this processor has no VNNI")
    assert main(["models"]) == 0
    text = capsys.readouterr().out
    assert f"{models.DEFAULT} is not for this machine: this processor has no VNNI; use slow" in text
    assert "bicubic is not" not in text
    assert main(["models", "--json"]) == 0
    listed = {model["name"]: model for model in json.loads(capsys.readouterr().out)}
    assert listed[models.DEFAULT]["unsupported_reason"] == "this processor has no VNNI"
    assert listed["bicubic"]["unsupported_reason"] == ""


def test_evaluate(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    high = np.repeat(np.repeat(make_picture(20, 20), 2, 0), 2, 1)
    (tmp_path / "a_HR.png").write_bytes(encode(high, ".png"))
    (tmp_path / "a_LR.png").write_bytes(encode(high[::2, ::2], ".png"))
    assert main(["evaluate", "nearest", str(tmp_path)]) == 0
    assert "PSNR inf dB, SSIM 1.0000" in capsys.readouterr().out
    assert "no such folder" in fails(capsys, "evaluate", "nearest", tmp_path / "gone")
    assert "gpt" in fails(capsys, "evaluate", "gpt", tmp_path)
    assert "_LR.png" in fails(capsys, "evaluate", "nearest", Path(__file__).parent)


def test_evaluate_names_the_current_folder(tmp_path, capsys, monkeypatch):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    (tmp_path / "a.png").write_bytes(encode(np.full((16, 16, 3), 90, np.uint8), ".png"))
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", "nearest", ".", "--degradation", "box"]) == 0
    assert f"nearest on {tmp_path.name} (box): " in capsys.readouterr().out


def test_evaluate_takes_its_words_around_options(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    (tmp_path / "a.png").write_bytes(encode(np.full((16, 16, 3), 90, np.uint8), ".png"))
    for argv in (
        ["nearest", "--degradation", "box", str(tmp_path)],
        ["--degradation", "box", "nearest", str(tmp_path)],
    ):
        assert main(["evaluate", *argv]) == 0
        assert "PSNR inf dB" in capsys.readouterr().out


def test_evaluate_a_light_field(tmp_path, capsys, monkeypatch):
    asked = []

    def evaluate(model, folder, **options):
        asked.append((model, folder, options))
        if options["grid"] == (9, 9):
            raise ValueError("knights: no view (8, 8); give a smaller grid")
        return Accuracy("knights 5x5 (bicubic)", 25, 31.234, 0.95)

    monkeypatch.setitem(sys.modules, "ciir.training.evaluation.light_fields", SimpleNamespace(evaluate=evaluate))
    given = ["evaluate", "--light-field", str(tmp_path)]
    protocol = {"grid": (5, 5), "scale": 2, "degradation": "bicubic"}
    assert main(given) == 0
    assert "knights 5x5 (bicubic): PSNR 31.23 dB, SSIM 0.9500 on Y over 25 views" in capsys.readouterr().out
    assert main([*given, "--grid", "3x7", "--degradation", "point", "quality"]) == 0
    assert main(["evaluate", "quality", *given[1:], "--scale", "4"]) == 0
    capsys.readouterr()
    assert asked == [
        (models.catalogue.LIGHT_FIELD_DEFAULT, tmp_path, protocol),
        ("quality", tmp_path, protocol | {"grid": (3, 7), "degradation": "point"}),
        ("quality", tmp_path, protocol | {"scale": 4}),
    ]
    assert "no view (8, 8)" in fails(capsys, *given, "--grid", "9x9")


WITHOUT_TORCH = """
import sys
from ciir.service.cli.main import main
sys.modules["torch"] = None
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("command", ["train", "export"])
def test_training_without_torch_names_the_remedy(tmp_path, command):
    (tmp_path / "c.pt").write_bytes(b"")
    given = {"train": ROOT / "training" / "recipes" / "fast.toml", "export": tmp_path / "c.pt"}[command]
    done = run_python("-c", WITHOUT_TORCH, command, given, "-o", tmp_path / "out")
    assert (done.returncode, done.stdout) == (2, "")
    assert "pip install 'ciir[training]'" in done.stderr


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
        (["nothing"], ["nothing", "reconstruct"]),
        (["reconstruct"], ["INPUT", "-o"]),
        (["reconstruct", "gone.glb", "-o", "out"], ["gone.glb"]),
        (["reconstruct", "scene:teapot", "-o", "out"], ["teapot", "hamburger"]),
        (["reconstruct", "scene:vase", "-o", "out", "--len", "5x5"], ["--len"]),
        (["reconstruct", "scene:vase", "-o", __file__, "--model", "none"], ["a file is there"]),
        (["elemental", "scene:vase", "-o", "eia.gif"], ["eia.gif", ".png"]),
        (["elemental", "scene:vase", "-o", "eia.jpg", "--model", "paper"], ["--model"]),
        (["serve", "--port", "many"], ["port", "65535"]),
        (["reconstruct", "scene:vase", "-o", "out", "--lenses", "-5x5"], ["lenses: '-5x5'", "100x100"]),
        (["reconstruct", "scene:vase", "-o", "out", "--views", "-1,0"], ["views: '-1,0'", "center"]),
        (["reconstruct", "scene:vase", "-o", "out", "--delta", "-1e-3"], ["delta: -0.001", "positive"]),
        (["reconstruct", "scene:vase", "--views", "-o", "out"], ["--views", "expected one argument"]),
        (["reconstruct", "scene:vase", "-o", "o" * 300], ["too long", "name a place"]),
        (["evaluate"], ["MODEL", "--light-field"]),
        (["evaluate", "fast"], ["MODEL", "--light-field"]),
        (["evaluate", "fast", "--foo", "a"], ["unrecognized", "--foo"]),
        (["evaluate", "fast", "a", "--grid", "5x5"], ["--grid", "--light-field"]),
        (["evaluate", "--light-field", "gone"], ["gone", "no such folder", "views"]),
        (["evaluate", "--light-field", ".", "--grid", "5"], ["grid: '5'", "rows x columns"]),
        (["evaluate", "--light-field", ".", "fast", "a"], ["'a'", "one of them"]),
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


def test_an_old_result_survives_a_fault(eia_file, tmp_path, capsys):
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
        "heavy = {'trimesh', 'OpenGL', 'onnxruntime', 'PIL', 'fastapi', 'torch'} & set(sys.modules); "
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
        note = "ciir: note: order: 5x5 views, rows x columns: of 0_4.png 0 is the column and 4 the row, which fits"
        assert capsys.readouterr().err.startswith(note) == is_noted
        written = np.load(tmp_path / "out.npz")["views"][0]
        assert np.array_equal(written, views[0, 4] if is_noted else views[4, 0])


def test_upscale_says_what_it_takes(tmp_path, capsys):
    takes = [".png", ".tif", "folder"]
    for name, data, parts in (
        ("a.bmp", b"BM", takes),
        ("a.png", b"hello", ["text", "PNG", "save it again"]),
        ("b.jpg", encode(EIA, ".png"), takes),
    ):
        (tmp_path / name).write_bytes(data)
        line = fails(capsys, "upscale", tmp_path / name, "-o", tmp_path / "out.png")
        assert contains_all(line, [name, *parts])
        assert ".glb" not in line


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
    assert "'' is no name" in fails(capsys, "reconstruct", "", "-o", tmp_path / "out")


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


def test_skipping_is_an_option(tmp_path, capsys):
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[10:14, 10:14] = 200
    (tmp_path / "a.png").write_bytes(encode(picture, ".png"))
    argv = ["upscale", str(tmp_path / "a.png"), "--model", "fast"]
    assert main([*argv, "-o", str(tmp_path / "b.png"), "--report", str(tmp_path / "b.json")]) == 0
    assert main([*argv, "-o", str(tmp_path / "c.png"), "--report", str(tmp_path / "c.json"), "--skip", "none"]) == 0
    exact, none = (json.loads((tmp_path / name).read_text())["skipped"] for name in ("b.json", "c.json"))
    assert (exact["uniform"] > 0.2, none["uniform"]) == (True, 0)
    capsys.readouterr()
    assert "exact or none" in fails(capsys, *argv, "-o", tmp_path / "d.png", "--skip", "some")
