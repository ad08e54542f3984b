import io

import numpy as np
import pytest
import tifffile
from PIL import Image

from ciir import models
from ciir.errors import InputError, InvalidOption, UnsupportedScale
from ciir.renderer.levels import ROUNDED
from ciir.renderer.readers.layout import TEXT, write_text
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from ciir.service.pipeline.pictures import output_names, upscale_files
from tests.support.inputs import EIA, make_picture, make_profile


def run(files, model="bicubic", scale=2):
    written, counts = {}, []
    report = upscale_files(
        files,
        output_names(list(files)),
        written.__setitem__,
        model=model,
        scale=scale,
        progress=lambda *count: counts.append(count),
    )
    assert counts == [(done, len(files)) for done in range(len(files) + 1)]
    return written, report


def test_names():
    assert output_names(["a.png", "b.tif", "C.TIFF", "d.jpg"]) == {
        "a.png": "a.png", "b.tif": "b.tif", "C.TIFF": "C.tiff", "d.jpg": "d.png",
    }  # fmt: skip
    assert output_names(["photo", "v2.1/photo"]) == {"photo": "photo.png", "v2.1/photo": "v2.1/photo.png"}
    with pytest.raises(InvalidOption, match=r"a\.jpg and a\.png.*rename"):
        output_names(["a.png", "a.jpg"])


@pytest.mark.parametrize(
    ("suffix", "channels", "dtype"),
    [(".png", 1, np.uint8), (".png", 4, np.uint16), (".tif", 2, np.uint16), (".tif", 3, np.uint8)],
)
def test_depth_and_channels_are_kept(suffix, channels, dtype):
    picture = make_picture(5, 7, channels, dtype)
    written, report = run({f"a{suffix}": encode(picture, suffix)})
    large = decode(written[f"a{suffix}"], name="a")
    assert large.dtype == dtype
    assert np.array_equal(large, models.upscale_pixels(models.load_upscaler("bicubic"), picture[np.newaxis])[0])
    assert report["pictures"] == [
        {"input": f"a{suffix}", "file": f"a{suffix}", "height": 10, "width": 14, "channels": channels,
         "bits": dtype().itemsize * 8}
    ]  # fmt: skip
    assert set(report["timings_ms"]) == {"decode", "upscale", "encode", "total"}


@pytest.mark.parametrize(("channels", "dtype"), [(4, np.uint8), (2, np.uint8), (3, np.uint16)])
def test_what_the_output_can_not_hold_is_refused_before_the_work(monkeypatch, channels, dtype):
    monkeypatch.setattr("ciir.models.single.pixels.upscale_pixels", pytest.fail)
    data = encode(make_picture(5, 7, channels, dtype), ".png")
    with pytest.raises(
        InvalidOption, match=r"x\.jpg: JPEG holds 8-bit grey or RGB without transparency, not.*\.png or \.tif"
    ):
        upscale_files({"a.png": data}, {"a.png": "x.jpg"}, pytest.fail, model="bicubic", scale=2)


def test_errors_name_the_file():
    good = encode(EIA, ".png")
    with pytest.raises(InputError, match=r"b\.png"):
        run({"a.png": good, "b.png": good[:100]})
    with pytest.raises(UnsupportedScale, match="scale"):
        run({"a.png": good}, model="paper", scale=3)
    with pytest.raises(InvalidOption, match="none"):
        run({"a.png": good}, model="none")


def test_floating_point_samples_are_noted():
    file = io.BytesIO()
    tifffile.imwrite(file, make_picture(5, 7).astype(np.float32) / 255, photometric="rgb")
    _, report = run({"a.tif": file.getvalue()})
    assert report["notes"] == [ROUNDED]


def test_pictures_of_several_views_are_noted():
    eia = encode(EIA, ".png", {TEXT: write_text("eia", (2, 2, 2, 2, 3))})
    other = encode(EIA, ".png", {"Software": "x"})
    _, report = run({"a.png": eia, "b.png": other, "c_qs8x6a0.75.png": other})
    names = [note.partition(":")[0] for note in report["notes"]]
    assert names == ["a.png", "c_qs8x6a0.75.png"]
    assert "upscaled as one picture; `ciir convert` with a model upscales each of them" in report["notes"][0]


def test_colour_profiles_that_are_not_srgb_are_noted_once_each():
    file = io.BytesIO()
    Image.fromarray(make_picture(5, 7)).save(file, "PNG", icc_profile=make_profile("Adobe RGB (1998)"))
    _, report = run({"a.png": file.getvalue(), "b.png": encode(EIA, ".png"), "c.png": file.getvalue()})
    profile = "the colour profile (Adobe RGB (1998)) is not sRGB and is left out"
    assert report["notes"] == [f"a.png and 1 more: {profile}; convert to sRGB first to keep colours"]
