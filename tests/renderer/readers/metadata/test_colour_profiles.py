import io
import struct
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageCms

from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.layout import Layout
from ciir.renderer.readers.metadata.colour_profiles import CORRUPT, name_profile
from ciir.renderer.writers.pictures import encode_png
from tests.support.inputs import make_profile

PIXELS = np.random.default_rng(0).integers(0, 256, (12, 12, 3), np.uint8)


def save(form: str, profile: bytes | None, **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(PIXELS).save(file, form, icc_profile=profile, **options)
    return file.getvalue()


FORMATS = ("PNG", "JPEG", "TIFF", "WEBP")


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("is_v4", [False, True])
def test_profiles_that_are_not_srgb_are_named(form: str, is_v4: bool) -> None:
    assert name_profile(save(form, make_profile("Display P3", is_v4=is_v4))) == "Display P3"
    assert name_profile(save(form, make_profile("Linear sRGB", is_v4=is_v4))) == "Linear sRGB"


@pytest.mark.parametrize("form", FORMATS)
def test_srgb_and_no_profile_have_no_name(form: str) -> None:
    built_in = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (None, built_in, make_profile("sRGB IEC61966-2.1"), make_profile("c2"), make_profile("sGrey")):
        assert name_profile(save(form, profile)) is None


def test_a_profile_in_several_segments() -> None:
    data = save("JPEG", make_profile("Wide", before=100_000))
    assert data.count(b"ICC_PROFILE\0") == 2
    assert name_profile(data) == "Wide"


def test_of_a_profile_that_swells_only_the_start_is_read() -> None:
    assert name_profile(save("PNG", make_profile("Wide") + bytes(1 << 22))) == "Wide"
    assert name_profile(save("PNG", make_profile("Wide", before=1 << 22))) == CORRUPT


@pytest.mark.parametrize("form", FORMATS)
def test_what_is_corrupt_or_unnamed_is_said_to_be(form: str) -> None:
    for profile in (b"p" * 50, make_profile("Wide")[:150], make_profile("\u0416", is_v4=True)[:-1]):
        assert name_profile(save(form, profile)) == CORRUPT
    assert name_profile(save(form, bytes(128) + struct.pack(">I", 0))) == "without a name"
    assert name_profile(save(form, make_profile("a\nb" + "c" * 200))).startswith("a?bccc")


def test_other_files_have_no_profile() -> None:
    assert [name_profile(data) for data in (b"", b"\x89PNG\r\n\x1a\n", b"glTF")] == [None] * 3


def test_light_fields_have_one_note() -> None:
    picture = save("PNG", make_profile("Display P3"))
    one = inputs.read(Bundle("a.png", "a.png", {"a.png": picture}), Layout(lenses=(3, 3)))
    views = {f"view_{v}_{u}.png": picture for v in range(2) for u in range(2)}
    words = "the colour profile (Display P3) is not sRGB and is left out; convert to sRGB first to keep colours"
    for found, name in ((one, "a.png"), (inputs.read(Bundle("x", None, views)), "view_1_1.png")):
        assert [note for note in found.notes if "colour profile" in note] == [f"{name}: {words}"]
    plain = inputs.read(Bundle("a.png", "a.png", {"a.png": encode_png(PIXELS)}), Layout(lenses=(3, 3)))
    assert not any("profile" in note for note in plain.notes)
