"""What `-o` and `--report` may name, and what of earlier runs and of failed ones stays there."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.writer import Contents
from ciir.service.cli import output_path
from ciir.service.cli.main import main
from tests.support.cli import SMALL, fails
from tests.support.displays import CALIBRATION
from tests.support.inputs import CUBE, contains_all, make_picture
from tests.support.servers import run_python


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, `here`, with a mesh, a picture and a folder of pictures beside it."""
    (tmp_path / "cube.off").write_bytes(CUBE)
    (tmp_path / "p.png").write_bytes(encode_png(make_picture(5, 6)))
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "p.png").write_bytes(encode_png(make_picture(5, 6)))
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


COMMANDS = {
    "reconstruct": ["reconstruct", "../cube.off", *SMALL, "--model", "none"],
    "upscale a picture": ["upscale", "../p.png", "--model", "nearest"],
    "upscale a folder": ["upscale", "../in", "--model", "nearest"],
}


def refused(capsys, argv, *words):
    line = fails(capsys, *argv)
    assert contains_all(line, words), line


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", [".", "./"])
def test_the_working_folder(folder, command, name):
    assert main([*COMMANDS[command], "-o", name]) == 0
    names = {path.name for path in folder.iterdir()}
    assert names == ({"report.json", "view_01_02.png"} if command == "reconstruct" else {"p.png"})
    assert {path.name for path in folder.parent.iterdir()} == {"cube.off", "here", "in", "p.png", "pipe"}


@pytest.mark.parametrize("command", [*COMMANDS, "demo", "elemental"])
def test_no_name_is_refused(folder, capsys, command):
    argv = COMMANDS.get(command, {"elemental": ["elemental", "../cube.off"]}.get(command, [command]))
    refused(capsys, [*argv, "-o", ""], "-o")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "name"),
    [
        *(("reconstruct", f"zz.{suffix}") for suffix in ("ico", "bmp", "ICO", "tar.gz", "pgn", "v2", "2024.11.29")),
        ("upscale a picture", "zz.gif"),
        ("upscale a picture", "zz.pgn"),
        ("upscale a folder", "zz.png"),
        ("upscale a folder", "zz.v2"),
        ("convert", "zz.npzz"),
        ("refocus", "zz.pgn"),
        ("batch", "{stem}.pgn"),
    ],
)
def test_a_file_of_another_kind_is_refused_before_any_work(folder, capsys, monkeypatch, command, name):
    for work in ("ciir.service.pipeline.run.reconstruct", "ciir.service.cli.commands.pictures.upscale.upscale_files"):
        monkeypatch.setattr(work, pytest.fail)
    words = {
        "convert": ["convert", "../cube.off"],
        "refocus": ["refocus", "../cube.off", "--disparity", "0"],
        "batch": ["batch", "../in", "-o", "out", "--name"],
    }
    given = words.get(command) or COMMANDS[command]
    refused(capsys, [*given, *([] if command == "batch" else ["-o"]), name], name, "/ for a folder")
    assert list(folder.iterdir()) == []


def test_the_demo_takes_a_folder(folder, capsys, monkeypatch):
    monkeypatch.setattr("ciir.service.demo.demo.run_demo", pytest.fail)
    refused(capsys, ["demo", "-o", "zz.png"], "zz.png", "/ for a folder")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", ["foo.png", "2024.11.29"])
def test_a_slash_means_a_folder_and_so_does_one_that_is_there(folder, command, name):
    for given in (f"{name}/", name):
        assert main([*COMMANDS[command], "-o", given]) == 0
        assert (folder / name).is_dir()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", ["x", "x.png"])
def test_an_error_names_what_was_given(folder, capsys, command, name):
    name = "x/" if command == "upscale a folder" else name
    line = fails(capsys, *COMMANDS[command], "-o", f"/proc/{name}")
    assert line.startswith(f"ciir: /proc/{name.rstrip('/')}: "), line


def test_elemental_makes_no_folder(folder, capsys):
    refused(capsys, ["elemental", "../cube.off", "-o", "eia.png/"], "eia.png/")


def test_names_of_folders(tmp_path):
    assert not output_path.names_file("run", [".png"], what="views")
    assert not output_path.names_file("run.v2/", [".png"], what="views")
    assert not output_path.names_file(".run", [".png"], what="views")
    assert not output_path.names_file(str(tmp_path), [".png"], what="views")
    (tmp_path / "there.jpg").mkdir()
    assert not output_path.names_file(str(tmp_path / "there.jpg"), [".png"], what="views")
    assert output_path.names_file("a.PNG", [".png"], what="views")
    with pytest.raises(InvalidOption, match="-o"):
        output_path.resolve_folder("", what="views")


@pytest.mark.parametrize("command", [*COMMANDS, "elemental"])
@pytest.mark.parametrize("report", ["../in", "../p.png/r.json", "../pipe", "o.png", ""])
def test_a_report_that_has_no_place_is_refused_before_any_work(folder, capsys, monkeypatch, command, report):
    for work in ("ciir.service.pipeline.run.reconstruct", "ciir.service.cli.commands.pictures.elemental.render_eia"):
        monkeypatch.setattr(work, pytest.fail)
    monkeypatch.setattr("ciir.service.cli.commands.pictures.upscale.upscale_files", pytest.fail)
    argv = COMMANDS.get(command, ["elemental", "../cube.off"])
    name = "o.png/" if command == "upscale a folder" else "o.png"
    refused(capsys, [*argv, "-o", name, "--report", report])
    assert list(folder.iterdir()) == []


PANEL = b"[panel]\npixels = [60, 40]\npitch = 0.1\n[lenses]\npitch = 1.0\ngap = 3.0\n"


@pytest.mark.parametrize(
    "words",
    [
        ["convert", "--lens-pitch", "9", "--white", "w.png", "-o", "w.png", "--to", "lenticular"],
        ["reconstruct", "--lens-pitch", "9", "--white", "w.png", "-o", "o", "--show-grid", "w.png"],
        ["reconstruct", "--lens-pitch", "9", "--dark", "w.png", "-o", "w.png"],
        ["convert", "--calibration", "w.png", "-o", "o.png", "--report", "w.png"],
        ["convert", "--display", "w.png", "-o", "./w.png"],
        ["reconstruct", "--lens-pitch", "9", "-o", "o.png", "--show-grid", "o.png"],
        ["reconstruct", "--lens-pitch", "9", "-o", "o", "--show-grid", "o.json", "--report", "o.json"],
    ],
)
def test_outputs_that_are_read_or_that_are_one_file_are_refused(folder, capsys, monkeypatch, words):
    monkeypatch.setattr("ciir.service.cli.common.open_input", pytest.fail)
    mine = {"--calibration": json.dumps(CALIBRATION).encode(), "--display": PANEL}.get(words[1], b"mine")
    (folder / "w.png").write_bytes(mine)
    refused(capsys, [words[0], "../p.png", *words[1:]], "give another place" if "w.png" in words else "two outputs")
    assert [path.name for path in folder.iterdir()] == ["w.png"]
    assert (folder / "w.png").read_bytes() == mine


def test_a_report_where_nothing_may_be_written(folder, capsys, monkeypatch):
    monkeypatch.setattr("ciir.renderer.writers.atomic_write.os.access", lambda path, mode: path != folder)
    refused(capsys, [*COMMANDS["reconstruct"], "-o", "../out", "--report", "r.json"], str(folder))
    assert not (folder.parent / "out").exists()


def views(folder):
    return sorted(path.name for path in folder.glob("*.png"))


def test_views_of_an_earlier_run_go(folder, capsys):
    run = [*COMMANDS["reconstruct"], "-o", "out", "--views"]
    assert main([*run, "all"]) == 0
    (folder / "out" / "other.png").write_bytes(b"mine")
    assert capsys.readouterr().err == ""
    assert main([*run, "1,2;0,0"]) == 0
    assert views(folder / "out") == ["other.png", "view_00_00.png", "view_01_02.png"]
    note = capsys.readouterr().err
    assert note.startswith("ciir: note: ")
    assert "13 (view_00_01.png to view_02_04.png)" in note
    assert json.loads((folder / "out" / "report.json").read_text())["notes"] == [note[12:-1]]
    assert main([*run, "0,0"]) == 0
    assert "1 (view_01_02.png)" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["reconstruct", "convert"])
@pytest.mark.parametrize("report", [None, b"{}", b'{"views": [{"file": "view_00_00.png"}]}'])
def test_views_that_ciir_did_not_make_are_refused_before_any_work(folder, capsys, monkeypatch, command, report):
    monkeypatch.setattr("ciir.service.pipeline.run.reconstruct", pytest.fail)
    (folder / "mine").mkdir()
    for name in ("view_00_00.png", "view_00_01.png", "view_1_0.png"):
        (folder / "mine" / name).write_bytes(b"mine")
    if report is not None:
        (folder / "mine" / "report.json").write_bytes(report)
    first = "2 files, view_00_01.png" if report and b"views" in report else "3 files, view_00_00.png"
    refused(
        capsys,
        [command, "../cube.off", *SMALL, "-o", "mine"],
        *("mine: ", f"{first} to view_1_0.png, are there", "give another folder", "remove them"),
    )
    assert [path.read_bytes() for path in (folder / "mine").glob("view*")] == [b"mine"] * 3


def test_frames_that_ciir_did_not_make_are_refused_where_frames_come(folder):
    (folder / "frame_0007.png").write_bytes(b"mine")
    contents = Contents(((0, 0), (0, 1)), (1, 2), 4, 4, 3, np.dtype(np.uint8), times=(0.0, 1.0))
    with FolderWriter(folder) as writer:
        writer.begin(replace(contents, times=()))
    with FolderWriter(folder) as writer, pytest.raises(InvalidOption, match=r"frame_0007.png is there .*remove"):
        writer.begin(contents)
    assert views(folder) == ["frame_0007.png"]


@pytest.mark.parametrize(
    "report",
    [
        b"{",
        b"[]",
        b"\xff",
        b'{"views": 3}',
        b'{"views": [{"file": "mine.png"}, {"file": "../p.png"}, {"file": "sub/view_00_00.png"}]}',
    ],
)
def test_what_another_report_lists_stays(folder, report):
    (folder / "sub").mkdir()
    mine = [folder / "mine.png", folder / "sub" / "view_00_00.png", folder.parent / "p.png"]
    for path in mine:
        path.write_bytes(b"mine")
    (folder / "report.json").write_bytes(report)
    assert main([*COMMANDS["reconstruct"], "-o", "."]) == 0
    assert [path.read_bytes() for path in mine] == [b"mine"] * 3


def test_what_is_read_stays(folder):
    assert main([*COMMANDS["reconstruct"], "-o", ".", "--views", "all"]) == 0
    assert (
        main(["reconstruct", "view_00_00.png", "--lenses", "6x5", "--views", "1,1", "--model", "none", "-o", "."]) == 0
    )
    assert views(folder) == ["view_00_00.png", "view_01_01.png"]
    assert main([*COMMANDS["reconstruct"], "-o", "."]) == 2  # no report lists view_00_00.png now
    assert views(folder) == ["view_00_00.png", "view_01_01.png"]
    (folder / "view_00_00.png").unlink()
    assert main([*COMMANDS["reconstruct"], "-o", ".", "--views", "all"]) == 0
    assert main(["reconstruct", ".", "-o", ".", "--views", "0,0", "--model", "none"]) == 2
    assert len(views(folder)) == 15


TERMINATED = """
import os, signal, sys
from ciir.service.cli.main import main
from ciir.renderer.writers import folder
folder.encode_png = lambda *given: os.kill(os.getpid(), signal.SIGTERM)
sys.exit(main(sys.argv[1:]))
"""


def test_sigterm_leaves_nothing(folder):
    done = run_python("-c", TERMINATED, *COMMANDS["reconstruct"], "-o", "out")
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "ciir: terminated\n")
    assert list(folder.iterdir()) == []
