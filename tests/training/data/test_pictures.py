"""Folders of pictures: which files are read, as which pixels, and errors."""

import numpy as np
import pytest
from PIL import Image

from ciir.training.data.pictures import Pictures, find_pictures, read_picture, read_rgb

GREY = np.arange(0, 240, 4, dtype=np.uint8).reshape(6, 10)
COLOUR = np.stack([GREY, 255 - GREY, GREY // 2], axis=2)


def save(path, image, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    (Image.fromarray(image) if isinstance(image, np.ndarray) else image).save(path, **options)
    return path


@pytest.mark.parametrize("named", [".", "VOCdevkit", "VOCdevkit/VOC2012", "VOCdevkit/VOC2012/JPEGImages"])
def test_voc2012_as_it_unpacks(tmp_path, named):
    voc = tmp_path / "VOCdevkit" / "VOC2012"
    wanted = [save(voc / "JPEGImages" / f"2007_{i:06}.jpg", COLOUR) for i in (27, 32)]
    save(voc / "SegmentationClass" / "2007_000032.png", Image.fromarray(GREY).convert("P"))
    (voc / "Annotations").mkdir()
    (voc / "Annotations" / "2007_000027.xml").write_text("<annotation/>")
    assert find_pictures(tmp_path / named) == wanted


def test_other_files_hidden_ones_and_folders_are_ignored(tmp_path):
    b, a = (save(tmp_path / name, COLOUR) for name in ("b.PNG", "a.tiff"))
    (tmp_path / "notes.txt").write_text("")
    (tmp_path / "._b.png").write_bytes(b"Mac OS X")
    (tmp_path / "c.png").mkdir()
    assert find_pictures(tmp_path) == [a, b]


def test_no_folder_and_no_picture(tmp_path):
    with pytest.raises(ValueError, match="gone: no such folder; name a folder of pictures"):
        find_pictures(tmp_path / "gone")
    with pytest.raises(ValueError, match=r"no picture in it \(\.bmp, \.jpeg, \.jpg, .*\.tiff, \.webp\)"):
        find_pictures(tmp_path)


def test_every_kind_of_pixel_becomes_8_bit_rgb(tmp_path):
    def through(image, name="a.png"):
        return read_rgb(save(tmp_path / name, image))

    grey = np.stack([GREY] * 3, axis=2)
    np.testing.assert_array_equal(through(COLOUR), COLOUR)
    np.testing.assert_array_equal(through(GREY), grey)
    np.testing.assert_array_equal(
        through(Image.fromarray(COLOUR).quantize(256)), Image.open(tmp_path / "a.png").convert("RGB")
    )
    np.testing.assert_array_equal(through(GREY.astype(np.uint16) * 257), grey)
    np.testing.assert_array_equal(through(Image.fromarray(GREY > 99)), np.where(grey > 99, 255, 0))
    assert read_picture(tmp_path / "a.png").shape == (6, 10, 1)


def test_transparent_pixels_are_blended_with_black(tmp_path):
    alpha = np.full_like(GREY, 255)
    alpha[0], alpha[1] = 0, 128
    got = read_picture(save(tmp_path / "a.png", np.dstack([COLOUR, alpha])))
    np.testing.assert_array_equal(got[2:], COLOUR[2:])
    assert (got[0] == 0).all()
    np.testing.assert_array_equal(got[1], np.floor(COLOUR[1] * (128 / 255) + 0.5))
    assert read_picture(save(tmp_path / "b.png", np.dstack([GREY, alpha]))).shape == (6, 10, 1)


@pytest.mark.parametrize("memory", [0, 2**20])
def test_pictures_of_12_bits_fill_the_range_all_alike(tmp_path, memory):
    full = GREY.astype(np.uint16) * 257
    save(tmp_path / "a.png", (full >> 5))  # a darker one, of 11 bits
    save(tmp_path / "b.png", (full >> 4))
    found = Pictures(tmp_path, memory=memory)
    for number, expected in enumerate((GREY // 2, GREY)):
        assert np.abs(found[number].astype(int) - expected[..., np.newaxis]).max() <= 1
    save(tmp_path / "c.jpg", COLOUR)  # 8 bits say nothing of the others
    assert np.abs(Pictures(tmp_path, memory=memory)[1].astype(int) - GREY[..., np.newaxis]).max() <= 1
    save(tmp_path / "d.png", full)  # by which the others are dark
    assert Pictures(tmp_path, memory=memory)[1].max() == round(GREY.max() / 16)


def test_bad_pictures_are_named_at_the_start(tmp_path):
    file = save(tmp_path / "b.jpg", COLOUR)
    save(tmp_path / "a.jpg", COLOUR)
    whole = file.read_bytes()
    for bad in (whole[: len(whole) * 2 // 3], b"", b"text"):
        file.write_bytes(bad)
        with pytest.raises(ValueError, match=r"b\.jpg"):
            Pictures(tmp_path)
    save(file, Image.fromarray(COLOUR).convert("CMYK"))
    with pytest.raises(ValueError, match=r"b\.jpg: a JPEG of CMYK colours; convert it to RGB or grey"):
        Pictures(tmp_path)


def test_memory_limits_only_what_is_kept(tmp_path):
    for i in range(4):
        save(tmp_path / f"{i}.png", COLOUR + np.uint8(i))
    tight, roomy = Pictures(tmp_path, memory=2 * COLOUR.nbytes), Pictures(tmp_path)
    assert (len(tight._kept), len(roomy._kept), len(tight)) == (2, 4, 4)
    assert tight.sizes == [(6, 10)] * 4
    for i in range(4):
        np.testing.assert_array_equal(tight[i], COLOUR + np.uint8(i))
    save(tmp_path / "3.png", COLOUR[1:])
    with pytest.raises(ValueError, match=r"3\.png: was changed during the run"):
        tight[3]
