import json
import re
from dataclasses import fields
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import ImageColor

from ciir.errors import InvalidOption
from ciir.renderer.focus import occluders, planes
from ciir.renderer.readers.lenslet.grid import Known
from ciir.renderer.writers.options import TEXT_FILES
from ciir.service.pipeline.options import NAMES, Options, write_texts
from ciir.service.pipeline.options.focus import Method, Occluders
from ciir.service.pipeline.options.options import describe
from ciir.service.pipeline.options.rotation import list_yaws


def test_every_option_is_described():
    assert tuple(field.name for field in fields(Options)) == NAMES


def test_parses_every_option():
    texts = {
        "lenses": "50x60", "pixels": "15X11", "views": " all ", "model": "bicubic", "scale": "3", "strategy": "direct",
        "backend": "raytrace", "sampling": "lenslet", "pickup": "optical", "background": "#ff8000", "pitch": "0.5",
        "delta": "1e-2", "fusion": "always", "skip": "exact", "neighbour_time": "0.25", "order": "given", "flip": "uv",
        "transpose": "yes", "depth_sense": "lenses", "arrangement": "mosaic", "crop": "1, 2,3,4", "parallax": "30",
        "up": " Z ",
        "rotate": "30, -20,0.5", "zoom": "1.5", "place": "-0.5", "depth_factor": "0.5", "fit": "none",
        "light": "-90,45", "epi": "y=3,v=1",
        "time": "0,1.5", "animation": "Run", "camera": " Front left ",
        "lens_pitch": "14.37", "lens_offset": "5.3, 8.8", "lens_rotation": "0.8", "lens_grid": "hexagonal",
        "path": "spiral", "frame": "7", "frames": "90", "fps": "25", "device": " go ", "quilt": "5 X 9",
        "aspect": "1.6", "calibration": '{"pitch": 1}', "print": " 152 x 102 MM", "lpi": "60", "dpi": "720",
        "view_distance": "16 in", "view_angle": "54", "display": "[panel]\n", "conversion": "none",
        "disparity": "-0.5", "depth": "120", "stack": "-1:1.5:16", "stack_of": "depths", "method": "window",
        "all_in_focus": "yes", "occluders": "remove",
        "aperture": "2.5", "aperture_shape": "gauss", "camera_pitch": "2", "focal_length": "35", "sensor": "36",
        "convergence": "500", "view": " 0, 4", "limits": "-2:2", "points": "yes",
    }  # fmt: skip
    assert set(texts) == set(NAMES)
    assert Options.parse(texts) == Options(
        lenses=(50, 60), pixels=(15, 11), views="all", model="bicubic", scale=3, strategy="direct", backend="raytrace",
        sampling="lenslet", pickup="optical", background=(255, 128, 0), pitch=0.5, delta=0.01,
        fusion="always", skip="exact",
        neighbour_time=0.25, order="given", flip="uv", transpose="yes", depth_sense="lenses",
        arrangement="mosaic", crop=(1, 2, 3, 4),
        parallax=30.0, up="z",
        rotate=(30.0, -20.0, 0.5), zoom=1.5, place=-0.5, depth_factor=0.5, fit="none", light=(-90.0, 45.0),
        epi="y=3,v=1",
        time=(0.0, 1.5), animation="Run", camera="Front left",
        lens_pitch=14.37, lens_offset=(5.3, 8.8), lens_rotation=0.8, lens_grid="hexagonal",
        path="spiral", frame=7, frames=90, fps=25.0, device="go", quilt="5x9",
        aspect=1.6, calibration='{"pitch": 1}', print="152x102mm", lpi=60.0, dpi=720.0,
        view_distance="16in", view_angle=54.0, display="[panel]\n", conversion="none", disparity=-0.5,
        depth=120.0, stack=(-1.0, 1.5, 16.0), stack_of="depths", method="window", aperture=2.5,
        all_in_focus="yes", occluders="remove",
        aperture_shape="gauss", camera_pitch=2.0, focal_length=35.0, sensor=36.0, convergence=500.0, view=(0, 4),
        limits=(-2.0, 2.0), points="yes",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("lenses", "50"), ("lenses", "0x5"), ("lenses", "-1x5"), ("lenses", "5x5x5"), ("pixels", "axb"),
        ("scale", "2.5"), ("scale", "0"), ("scale", "9"), ("scale", ""), ("strategy", "fast"), ("backend", "gpu"),
        ("sampling", "x"), ("pickup", "x"), ("background", "crimson"), ("background", "ffff"), ("pitch", "wide"),
        ("pitch", "0"), ("pitch", "-1"), ("pitch", "nan"), ("delta", "inf"), ("delta", "1e10"), ("depth", "far"),
        ("skip", "all"), ("order", "diagonal"), ("flip", "x"), ("transpose", "maybe"),
        ("crop", "1,2,3"), ("crop", "1,2,3,-4"), ("arrangement", "quilt"),
        ("neighbour_time", "-1"), ("neighbour_time", "nan"),
        ("neighbour_time", "soon"), ("neighbour_time", "inf"), ("up", "x"), ("rotate", "30,20"), ("rotate", "1,2,3,4"),
        ("rotate", "1,2,up"), ("rotate", "1000,0,0"), ("light", "1,2,3"), ("light", "nan,0"), ("light", "400,0"),
        ("light", "0,91"), ("zoom", "0"), ("zoom", "1_5"),
        ("place", "-1.1"), ("place", "before"), ("depth_factor", "0"), ("depth_factor", "-1"),
        ("parallax", "0"), ("parallax", "180"), ("parallax", "wide"),
        ("epi", "3"), ("epi", "x=1,v=2"),
        ("time", "-1"), ("camera", "x" * 201),
        ("lens_pitch", "wide"), ("lens_pitch", "4"), ("lens_pitch", "nan"), ("lens_offset", "5"),
        ("lens_offset", "-1,2"), ("lens_rotation", "46"), ("lens_grid", "round"),
        ("disparity", "near"), ("disparity", "nan"), ("depth", "inf"), ("stack", "1:2"), ("stack", "1:2:3.5"),
        ("stack", "1:nan:3"), ("stack_of", "views"), ("method", "shift"), ("aperture", "0"), ("aperture_shape", "star"),
        ("camera_pitch", "0"), ("view", "4"), ("view", "-1,2"), ("limits", "1"), ("limits", "a:b"),
        ("path", "square"), ("frames", "0"), ("frames", "1.5"), ("fps", "0"), ("fps", "nan"),
        ("quilt", "8"), ("quilt", "8x-1"), ("aspect", "0"), ("conversion", "x"),
        ("print", "6x4"), ("print", "0x4in"), ("lpi", "0"), ("dpi", "fine"), ("view_distance", "16"),
        ("view_distance", "0mm"), ("view_angle", "180"),
        ("calibration", "x" * 70_000), ("display", "x" * 70_000),
    ],
)  # fmt: skip
def test_an_error_names_the_option_in_one_line(name, text):
    with pytest.raises(InvalidOption, match=name) as caught:
        Options.parse({name: text})
    assert "\n" not in str(caught.value)
    assert ";" in str(caught.value)  # what is wrong; the remedy


@pytest.mark.parametrize(
    ("name", "text", "most"),
    [("lenses", "1000000x5", "999,999"), ("frame", "1000000", "999999"), ("scale", "1234567", "8")],
)
def test_a_number_that_is_too_large_is_out_of_range(name, text, most):
    """It is a number, and the limit is named."""
    with pytest.raises(InvalidOption, match=f"^{name}: {text} is out of range; give .* {most}"):
        Options.parse({name: text})


def test_an_error_repeats_only_so_much_of_what_was_given():
    long = "\x81" * 60_000
    for texts in (
        {f"{number}{long}": "1" for number in range(9)},
        *({name: long} for name in NAMES if name not in {"model", *TEXT_FILES}),  # looked up later
    ):
        with pytest.raises(InvalidOption) as caught:
            Options.parse(texts)
        assert len(str(caught.value)) < 1000
        assert str(caught.value).isprintable()


@settings(max_examples=50)
@given(st.lists(st.floats(-999, 999), min_size=3, max_size=3))
def test_angles_are_written_as_they_are_read(angles):
    texts = write_texts({"rotate": angles})
    assert Options.parse(texts).rotate == Options.convert({"rotate": angles}).rotate == pytest.approx(angles, abs=1e-6)


@pytest.mark.parametrize("value", [(1, 2), "1,2", (1, 2, None), (1, 2, float("nan")), (1, 2, 1000), 1000])
def test_other_angles_are_refused(value):
    with pytest.raises(InvalidOption, match="YAW,PITCH,ROLL"):
        Options.convert({"rotate": value})


@settings(max_examples=50)
@given(st.floats(-1e8, 1e8), st.floats(-1e8, 1e8), st.integers(2, 999))
def test_stacks_and_views_are_written_as_they_are_read(first, last, count):
    given = {"stack": (first, last, count), "limits": (first, last), "view": (count, 0)}
    read, converted = Options.parse(write_texts(given)), Options.convert(given)
    assert read == converted
    assert read.stack == pytest.approx(given["stack"], rel=1e-12, abs=1e-9)
    assert (read.limits, read.view) == (read.stack[:2], (count, 0))


def test_names_of_methods_are_those_of_the_planes():
    assert get_args(Method) == get_args(planes.Method)
    assert get_args(Occluders) == get_args(occluders.Occluders)


@pytest.mark.parametrize("space", [" ", "\t", "\x1f", "\u2003"])
def test_white_space_around_a_value_is_left_aside(space):
    for name, value in (("scale", "3"), ("lenses", "5x6"), ("background", "ff8000"), ("pitch", "0.5")):
        assert Options.parse({name: space + value + space}) == Options.parse({name: value})


@settings(max_examples=50)
@given(st.dictionaries(st.sampled_from(NAMES), st.text(max_size=20)))
def test_any_text_gives_options_or_an_error(texts):
    try:
        options = Options.parse(texts)
    except InvalidOption:
        return
    json.dumps(options.as_dict(), allow_nan=False)


@pytest.mark.parametrize("text", ["0,0;7,7", "0,0 7,7", " 0, 0;  7 ,7 ", "0,0\n7,7"])
def test_views_are_separated_by_white_space_too(text):
    """In a shell and in curl's -F, a semicolon ends a value."""
    assert Options.parse({"views": text}).views == "0,0;7,7"


def test_the_schema_of_views_takes_white_space_between_them():
    assert re.fullmatch(describe("views")["pattern"], "0,0 7,7")


def test_the_lens_grid_is_known_as_far_as_it_is_given():
    assert Options().known_grid is None
    assert Options.parse({"lens_pitch": "auto"}).known_grid == Known()
    given = {"lens_pitch": 14.37, "lens_offset": (5, 8.8), "lens_rotation": 0, "lens_grid": "square"}
    assert Options.convert(given).known_grid == Known(14.37, (5.0, 8.8), 0.0, "square")
    for name in ("lens_offset", "lens_rotation", "lens_grid"):
        with pytest.raises(InvalidOption, match=f"{name}: this needs lens_pitch"):
            Options.convert({name: given[name]}).known_grid  # noqa: B018 - it raises


@pytest.mark.parametrize(
    ("text", "times", "written"),
    [
        ("1.5", (1.5,), "1.5"),
        (" 0, 0.5,1 ", (0, 0.5, 1), "0:1:3"),
        ("0:2:5", (0, 0.5, 1, 1.5, 2), "0:2:5"),
        ("1:0:3", (1, 0.5, 0), "1:0:3"),
        ("0,1,3", (0, 1, 3), "0,1,3"),
        ("0:1:1", (0,), "0"),
    ],
)
def test_times_are_written_as_they_are_read(text, times, written):
    assert Options.parse({"time": text}).time == times
    assert write_texts({"time": times}) == {"time": written}
    assert Options.parse({"time": written}).time == times


@pytest.mark.parametrize("value", ["0:1", "0:1:0", "-1", "1e3", "0:1:4000", "", (), (1, -1), (float("nan"),), [None]])
def test_other_times_are_refused(value):
    with pytest.raises(InvalidOption, match=r"^time: "):
        Options.convert({"time": value})


@pytest.mark.parametrize(
    ("text", "colour"),
    [
        ("ff8000", (255, 128, 0)),
        (" #FF8000 ", (255, 128, 0)),
        ("#f80", (255, 136, 0)),
        ("f80", (255, 136, 0)),
        ("white", (255, 255, 255)),
        ("Black", (0, 0, 0)),
    ],
)
def test_colours(text, colour):
    assert Options.parse({"background": text}).background == colour
    assert re.fullmatch(describe("background")["pattern"], text.strip().lower())


def test_names_of_colours_are_those_of_css():
    names = "black silver gray white maroon red purple fuchsia green lime olive yellow navy blue teal aqua"
    for name in names.split():
        assert Options.parse({"background": name}).background == ImageColor.getrgb(name)


@pytest.mark.parametrize("text", ["transparent", "ff000080", "rgba(0,0,0,0)"])
def test_no_background_is_transparent(text):
    with pytest.raises(InvalidOption, match="nothing is transparent: give a colour that can be keyed out"):
        Options.parse({"background": text})


@pytest.mark.parametrize(
    ("text", "written", "yaws"),
    [
        ("0:360:4", "0:360:4,0,0", (0, 90, 180, 270)),
        ("0 : -720 : 3, 20, -5.5", "0:-720:3,20,-5.5", (0, -240, -480)),
        ("-30:30:3", "-30:30:3,0,0", (-30, 0, 30)),
        ("5:5:2", "5:5:2,0,0", (5, 5)),
        ("0:360:1", "0:360:1,0,0", (0,)),
        ("7,8,9", "7,8,9", (7,)),
        (" -90 ", "-90,0,0", (-90,)),
    ],
)
def test_several_yaws_are_written_as_they_are_read(text, written, yaws):
    rotate = Options.parse({"rotate": text}).rotate
    assert list_yaws(rotate) == yaws
    assert write_texts({"rotate": rotate}) == {"rotate": written}
    assert Options.parse({"rotate": written}) == Options.convert({"rotate": list(rotate)})


def test_a_yaw_alone():
    assert Options.convert({"rotate": 90}) == Options.convert({"rotate": (90, 0, 0)})


@pytest.mark.parametrize(
    "value", ["0:360", "0:360:0", "0:360:4000", "0:1000:4", "0:360:4,1", ((0, 360, 0), 0, 0), ((0, 360, 2.5), 0, 0)]
)
def test_other_yaws_are_refused(value):
    with pytest.raises(InvalidOption, match=r"^rotate: .*; give"):
        Options.convert({"rotate": value})


def test_light_comes_from_a_direction_that_there_is():
    with pytest.raises(InvalidOption, match=r"^light: the elevation of 91 degrees is out of range; give -90 to 90$"):
        Options.parse({"light": "0,91"})
    with pytest.raises(InvalidOption, match=r"^light: the azimuth of -400 degrees is out of range; give -360 to 360$"):
        Options.parse({"light": "-400,0"})
    with pytest.raises(InvalidOption, match=r"light: \(0, 91\) is not understood; .*, at most 360, 90$"):
        Options.convert({"light": (0, 91)})
    assert Options.parse({"light": "-360,-90"}).light == (-360.0, -90.0)


@pytest.mark.parametrize("name", ["frames", "zoom"])
@pytest.mark.parametrize("value", [True, np.False_])
def test_true_and_false_are_no_numbers(name, value):
    with pytest.raises(InvalidOption, match=rf"^{name}: .* is not understood; give a (whole )?number such as"):
        Options.convert({name: value})


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("lenses", lambda value: (value, 50)),
        ("view", lambda value: (0, value)),
        ("views", lambda value: [(0, 0), (value, 7)]),
        ("crop", lambda value: (0, 0, value, 0)),
        ("background", lambda value: (value, 0, 0)),
        ("rotate", lambda value: (value, 0, 0)),
        ("time", lambda value: value),
        ("time", lambda value: (0, value)),
        ("animation", lambda value: value),
        ("quilt", lambda value: (value, 6)),
        ("stack", lambda value: (-1, 0, value)),
        ("limits", lambda value: (value, 2)),
        ("lens_pitch", lambda value: value),
        ("lens_offset", lambda value: (value, 1)),
        ("rotate", lambda value: ((0, 90, value), 0, 0)),
    ],
)
@pytest.mark.parametrize("value", [True, np.True_])
def test_true_is_no_number_among_others(name, make, value):
    with pytest.raises(InvalidOption, match=rf"^{name}: .*True.* is not understood; give "):
        Options.convert({name: make(value)})
