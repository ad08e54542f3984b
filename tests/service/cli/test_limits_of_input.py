"""CIIR_MAX_... in the environment bound what the commands read, and errors name them."""

import pytest

from ciir.renderer.writers.pictures import encode
from ciir.service.cli.main import main
from tests.support.cli import SMALL, fails
from tests.support.inputs import CUBE, EIA, contains_all


@pytest.mark.parametrize(
    ("name", "value", "command"),
    [
        ("CIIR_MAX_TRIANGLES", 11, ["reconstruct", "cube.off"]),
        ("CIIR_MAX_TRIANGLES", 11, ["elemental", "cube.off"]),
        ("CIIR_MAX_UNPACKED_BYTES", 1024, ["reconstruct", "large.off"]),
        ("CIIR_MAX_FILES", 1, ["reconstruct", "views"]),
        ("CIIR_MAX_VIEWS", 3, ["reconstruct", "views"]),
        ("CIIR_MAX_VIEWS", 224, ["reconstruct", "scene:vase", "--views", "all"]),
        ("CIIR_MAX_SET_BYTES", 100, ["reconstruct", "views"]),
        ("CIIR_MAX_PIXELS", 100, ["reconstruct", "eia.png", "--lenses", "6x9"]),
        ("CIIR_MAX_PIXELS", 100, ["upscale", "eia.png"]),
    ],
)
def test_the_environment_sets_limits_on_what_is_read(
    cube_file, eia_file, tmp_path, monkeypatch, capsys, *, name, value, command
):
    (tmp_path / "large.off").write_bytes(CUBE + b"# " + b" " * 1024)
    (tmp_path / "views").mkdir()
    for v, u in ((0, 0), (0, 1), (1, 0), (1, 1)):
        (tmp_path / "views" / f"view_{v:02d}_{u:02d}.png").write_bytes(encode(EIA[v::4, u::4].copy(), ".png"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(name, str(value))
    command = [*command, "-o", "out.png" if command[0] != "reconstruct" else "out"]
    line = fails(capsys, *command)
    assert line.endswith(f", or type {name}={10 * value} before the command\n"), line
    typed = line.split()[-4].split("=")
    monkeypatch.setenv(*typed)
    if command[1] != "scene:vase":  # 225 views of 200x200 pixels: seconds
        assert main([*command, *(["--model", "none"] if command[0] == "reconstruct" else [])]) == 0


def test_a_limit_that_suffices_is_named_at_once(tmp_path, monkeypatch, capsys):
    count = 500
    rows = "".join(f"{n} {n * n} 0\n" for n in range(count + 2))
    faces = "".join(f"3 {n} {n + 1} {n + 2}\n" for n in range(count))
    (tmp_path / "strip.off").write_text(f"OFF\n{count + 2} {count} 0\n{rows}{faces}")
    monkeypatch.setenv("CIIR_MAX_TRIANGLES", "10")
    line = fails(capsys, "reconstruct", tmp_path / "strip.off", "-o", tmp_path / "out")
    assert line.endswith(f"type CIIR_MAX_TRIANGLES={count} before the command\n")


def test_a_limit_of_the_environment_that_is_no_number(cube_file, tmp_path, monkeypatch, capsys):
    for text in ("many", "0", "-1", "1e6", "999999999999999"):
        monkeypatch.setenv("CIIR_MAX_TRIANGLES", text)
        line = fails(capsys, "reconstruct", cube_file, "-o", tmp_path / "out")
        assert contains_all(line, ["CIIR_MAX_TRIANGLES", text, "from 1 to 100000000", "4000000"])
    monkeypatch.setenv("CIIR_MAX_TRIANGLES", " ")  # counts as not set
    assert main(["reconstruct", str(cube_file), "-o", str(tmp_path / "out"), "--model", "none", *SMALL]) == 0
