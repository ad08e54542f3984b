import io
import struct

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")

from PIL import Image

from ciir.training.data import gather


def picture(seed, height=200, width=240):
    """Blobs with edges: nothing flat, and no two seeds alike."""
    small = np.random.default_rng(seed).integers(0, 256, (9, 9, 3), dtype=np.uint8)
    return Image.fromarray(small).resize((width, height), Image.Resampling.NEAREST)


def saved(image, kind, **options):
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def test_lossy_pictures_are_halved_and_lossless_ones_kept():
    large = picture(0, 400, 480)
    assert gather.load_picture(saved(large, "JPEG")).shape == (200, 240, 3)
    np.testing.assert_array_equal(gather.load_picture(saved(large, "PNG")), np.asarray(large))


def test_large_pictures_are_shrunk():
    assert max(gather.load_picture(saved(picture(1, 900, 1600), "PNG")).shape) == gather.DRAWN
    assert max(gather.load_picture(saved(picture(1, 2500, 5000), "JPEG")).shape) == gather.LOSSY


@pytest.mark.parametrize(
    "content", [b"", b"no picture", saved(picture(3), "PNG")[:200], saved(picture(3, 90, 240), "PNG")]
)
def test_other_files_and_small_pictures_are_skipped(content):
    assert gather.load_picture(content) is None


def test_tiles_cover_the_picture_without_the_flat_ones():
    pixels = np.random.default_rng(4).integers(0, 256, (30, 100, 3), dtype=np.uint8).repeat(10, 0).repeat(10, 1)
    assert [tile.shape for tile in gather.cut_tiles(pixels)] == [(300, 333, 3), (300, 333, 3), (300, 334, 3)]
    pixels[:, 333:666] = 7
    assert len(gather.cut_tiles(pixels)) == 2


def test_pictures_are_found_inside_resource_files_too(tmp_path):
    webp = saved(picture(5), "WEBP")
    assert struct.unpack_from("<I", webp, 4)[0] + 8 == len(webp)
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "a.rcc").write_bytes(b"qres RIFF no" + webp + b"between" + webp)
    (tmp_path / "b.PNG").write_bytes(saved(picture(6), "PNG"))
    (tmp_path / "text.txt").write_text("x")
    (tmp_path / "link.png").symlink_to(tmp_path / "b.PNG")
    found = [(path.name, length) for path, _, length in gather.find_pictures(tmp_path)]
    assert found == [("b.PNG", (tmp_path / "b.PNG").stat().st_size), ("a.rcc", len(webp)), ("a.rcc", len(webp))]


def test_each_picture_is_taken_once_and_test_pictures_never(tmp_path, capsys):
    source, tests, out = tmp_path / "art", tmp_path / "tests", tmp_path / "out"
    source.mkdir()
    tests.mkdir()
    for seed in range(4):
        (source / f"{seed}.png").write_bytes(saved(picture(seed), "PNG"))
    (source / "again.jpg").write_bytes(saved(picture(1, 400, 480), "JPEG"))  # the same picture, larger
    (tests / "x_HR.png").write_bytes(saved(picture(2, 100, 120), "PNG"))  # a test picture, smaller
    assert gather.gather_pictures([source], out, at_most=9, exclude=[tests]) == 3
    assert len(list(out.glob("art-*.png"))) == 3
    assert "3 pictures taken, 2 skipped" in capsys.readouterr().out
    assert gather.gather_pictures([source], tmp_path / "few", at_most=1) == 1


def test_errors_are_one_line(tmp_path, capsys):
    with pytest.raises(ValueError, match="no picture of 160 pixels or more"):
        gather.gather_pictures([tmp_path], tmp_path / "out", at_most=1)
    with pytest.raises(ValueError, match="at_most is 0; give 1 or more"):
        gather.gather_pictures([tmp_path], tmp_path / "out", at_most=0)
    with pytest.raises(ValueError, match="no picture in it"):
        gather.gather_pictures([tmp_path], tmp_path / "out", at_most=1, exclude=[tmp_path])
    (tmp_path / "a" / "images").mkdir(parents=True)
    (tmp_path / "b" / "images").mkdir(parents=True)
    with pytest.raises(ValueError, match="two folders have the same name"):
        gather.gather_pictures([tmp_path / "a" / "images", tmp_path / "b" / "images"], tmp_path / "out", at_most=1)
    with pytest.raises(SystemExit):
        gather.main([str(tmp_path / "gone"), "-o", str(tmp_path / "out")])
    assert "gone: no such folder" in capsys.readouterr().err
