import json

import numpy as np
import pytest

from ciir import models
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from ciir.service.cli.main import main
from tests.support.cli import fails, read
from tests.support.inputs import EIA, contains_all, make_netpbm, make_picture


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
    (source / "below").mkdir()
    (source / "below" / "c.png").write_bytes(encode(make_picture(4, 4), ".png"))
    (source / "notes.txt").write_text("hello")
    argv = ["upscale", str(source), "-o", str(out), "--model", "nearest", "--report", str(tmp_path / "r.json")]
    assert main(argv) == 0
    assert sorted(path.name for path in out.iterdir()) == ["a.png", "b.png"]
    notes = json.loads((tmp_path / "r.json").read_text())["notes"]
    assert notes == ["in a subfolder, skipped: below/c.png", "not a picture, skipped: notes.txt"]
    assert capsys.readouterr().err == "".join(f"ciir: note: {note}\n" for note in notes)
    (source / "a.png").rename(source / "below" / "a.png")
    (source / "b.jpg").unlink()
    assert "give a folder below it, such as below" in fails(capsys, "upscale", source, "-o", out)


def test_upscale_leaves_nothing_where_one_picture_is_bad(tmp_path, capsys):
    source, out = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    (source / "a.png").write_bytes(encode(EIA, ".png"))
    (source / "b.png").write_bytes(encode(EIA, ".png")[:100])
    assert "b.png" in fails(capsys, "upscale", source, "-o", out, "--model", "nearest")
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_upscale_takes_no_light_field_network(stand_in, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encode(make_picture(5, 6), ".png"))
    line = fails(capsys, "upscale", tmp_path / "a.png", "-o", tmp_path / "b.png", "--model", "field")
    assert contains_all(line, ["model field", "ciir reconstruct", "quality"])
    assert "`ciir reconstruct`" in fails(capsys, "upscale", "scene:vase", "-o", tmp_path / "b.png")
    assert "`ciir convert` writes the views of a light field" in fails(
        capsys, "upscale", "a.npy", "-o", tmp_path / "b.png"
    )
    assert main(["upscale", str(tmp_path / "a.png"), "-o", str(tmp_path / "b.png")]) == 0


def test_upscale_says_what_it_takes(tmp_path, capsys):
    takes = [".png", ".tif", "folder"]
    for name, data, parts in (
        ("a.tga", b"?", takes),
        ("a.png", b"hello", ["text", "PNG", "save it again"]),
        ("b.jpg", encode(EIA, ".png"), ["rename it to end with .png"]),
    ):
        (tmp_path / name).write_bytes(data)
        line = fails(capsys, "upscale", tmp_path / name, "-o", tmp_path / "out.png")
        assert contains_all(line, [name, *parts])
        assert ".glb" not in line


@pytest.mark.parametrize("channels", [1, 3])
def test_a_10_bit_ppm_is_upscaled_as_a_png_of_the_same_levels(channels, tmp_path):
    stored = make_picture(6, 7, channels, np.uint16) >> 6
    (tmp_path / "a.ppm").write_bytes(make_netpbm(stored, 1023))
    (tmp_path / "b.png").write_bytes(encode(stored, ".png"))
    made = []
    for name in ("a.ppm", "b.png"):
        assert main(["upscale", str(tmp_path / name), "--model", "bicubic", "-o", str(tmp_path / "out.png")]) == 0
        made.append(decode((tmp_path / "out.png").read_bytes(), name=name))
    assert (made[0].shape, made[0].dtype, made[0].max() > 255) == ((12, 14, channels), np.uint16, True)
    assert np.array_equal(*made)


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
