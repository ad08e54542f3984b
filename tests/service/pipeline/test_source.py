"""Which options fit which source, and light fields in memory."""

import numpy as np
import pytest

import ciir
from ciir.errors import InvalidOption
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.pictures import encode_png
from tests.support.light_fields import make_views
from tests.support.pipeline import run


def test_a_view_that_is_not_there_is_refused_with_what_was_taken_as_row_and_column():
    views = make_views((3, 5), channels=3)
    files = {f"{u}_{v}.png": encode_png(views[v, u]) for v in range(3) for u in range(5)}
    with pytest.raises(InvalidOption, match=r"views: 4,0 is not there; .* 3x5 views, .* 0 is the column and 2 the row"):
        run(Bundle("set", None, files), views="4,0", model="none")


@pytest.mark.parametrize("options", [{"flip": "u"}, {"transpose": "yes"}, {"order": "columns"}, {"crop": (1, 0, 0, 0)}])
def test_what_is_for_pictures_is_refused_for_a_mesh(options):
    with pytest.raises(InvalidOption, match=f"{next(iter(options))}: this is for pictures and"):
        run("vase", **options)


def test_a_light_field_in_memory_is_put_in_the_order_that_was_asked_for():
    field = LightField(make_views((2, 3), channels=3))
    taken, report = run(field, views="1,2", model="none", flip="uv")
    assert np.array_equal(taken[1, 2], field.views[0, 0])
    assert report["lens_array"]["depth_sense"] == "lenses"
    taken, _ = run(field, views="2,1", model="none", order="columns")
    assert np.array_equal(taken[2, 1], field.views[1, 2])


@pytest.fixture(scope="module")
def containers(tmp_path_factory):
    """A container, a stack, a quilt and a video of 3x4 views."""
    folder = tmp_path_factory.mktemp("containers")
    field = LightField(make_views((3, 4), side=32, channels=3), depth_sense="cameras", is_ordered=True)
    for name in ("a.mat", "a.tif", "a.gif"):
        field.save(folder / name, "stack" if name == "a.tif" else None)
    field.save(folder / "a_qs4x3a1.png", "eia")
    return folder


@pytest.mark.parametrize("name", ["a.mat", "a.tif", "a.gif", "a_qs4x3a1.png"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pitch": 2.0}, "pitch: this is for a lens array and {} holds views; leave it out"),
        ({"delta": 0.1}, "delta: this is for a lens array and {} holds views; leave it out"),
        ({"parallax": 30.0}, "parallax: this is for a lens array and {} holds views; leave it out"),
        ({"pickup": "optical"}, "pickup: this is for elemental image arrays and {} holds views; leave it out"),
        ({"crop": (0, 0, 1, 0)}, "crop: this is for elemental image arrays and {} holds views; leave it out"),
        (
            {"frame": 1},
            (
                "frame: this is for a video of elemental image arrays (with lenses or arrangement eia) or of quilts "
                "(NAME_qs8x6a0.75.mp4); leave it out for {}"
            ),
        ),
    ],
)
def test_what_views_in_a_file_ignore_is_refused(containers, name, options, message):
    with pytest.raises(InvalidOption) as caught:
        ciir.reconstruct(containers / name, views="all", model="none", **options)
    assert str(caught.value) == message.format(name)


def test_views_are_upright(containers):
    ciir.reconstruct(containers / "a.mat", model="none", pickup="virtual")


@pytest.mark.parametrize("name", ["a.mat", "a.tif", "a_qs4x3a1.png"])
def test_an_arrangement_is_refused_but_for_pictures_and_frames_of_a_video(containers, name):
    with pytest.raises(InvalidOption, match=f"arrangement: this is for elemental image arrays and {name} holds views"):
        ciir.reconstruct(containers / name, views="all", model="none", arrangement="eia")


@pytest.mark.parametrize("name", ["a.mat", "a.tif"])
def test_numbers_that_are_not_the_files_are_refused(containers, name):
    with pytest.raises(InvalidOption, match=f"lenses: 3x3 doesn't fit {name}, whose views have 32x32 pixels; leave"):
        ciir.open(containers / name, lenses=(3, 3))
    assert ciir.open(containers / name, lenses=(32, 32)).shape[:4] == (3, 4, 32, 32)
    with pytest.raises(InvalidOption, match=r"pixels: (a.mat has 3x4 views|7x5 asks for 35 views, but a.tif has 12)"):
        ciir.open(containers / name, pixels=(7, 5))


def test_a_frame_of_a_video_is_read_as_a_picture_is(containers):
    with pytest.raises(
        InvalidOption, match=r"^a\.gif, frame 0: a picture is read as an elemental image array; give the"
    ):
        ciir.open(containers / "a.gif", arrangement="eia")
    assert ciir.open(containers / "a.gif", lenses=(8, 8), arrangement="eia").shape == (4, 4, 8, 8, 3)
    assert ciir.open(containers / "a.gif", pixels=(4, 4), crop=(4, 0, 0, 0), arrangement="eia").shape[2:4] == (7, 8)
