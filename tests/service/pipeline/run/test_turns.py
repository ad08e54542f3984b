"""One view of a mesh at several yaws: it turns in its place, framed alike."""

import io

import av
import numpy as np
import pytest

from ciir.errors import InvalidOption, NothingVisible, TooLarge
from ciir.renderer.light_field import LightField
from ciir.renderer.limits import Limits
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.interface import Reconstruction
from ciir.service.pipeline.one_file import RUNS, Output
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import Clock
from ciir.service.pipeline.run import reconstruct
from ciir.service.pipeline.source import Input

CORNERS = np.array([(x, y, z) for x in (5.0, 8.0) for y in (0.0, 2.0) for z in (1.0, 2.0)])  # far from the origin
SQUARES = "f 1 3 7 5\nf 2 4 8 6\nf 1 2 4 3\nf 5 6 8 7\n"
BOX = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + SQUARES
SMALL = {"lenses": "30x40", "pixels": "3x3", "model": "none", "backend": "raytrace"}


def load_box(**limits) -> Bundle:
    return Bundle("box.obj", "box.obj", {"box.obj": BOX.encode()}, Limits(**limits))


def run(source=None, **options):
    writer = MemoryWriter()
    return writer.views, reconstruct(source or load_box(), Options.parse(SMALL | options), writer)


def place(rotate: str, **options) -> np.ndarray:
    """The box's corners where the report of the turn's first frame has them."""
    matrix = np.array(run(rotate=rotate, **options)[1]["scene_transform"])
    return CORNERS @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("more", ["", ",20,0", ",-30,15"])
def test_it_turns_about_its_middle_and_keeps_its_size(more):
    turns = [place(f"{yaw}:{yaw + 360}:12{more}") for yaw in (0, 30, 90, 240)]  # the same yaws, from another one on
    for placed in turns:
        assert placed.mean(axis=0) == pytest.approx(turns[0].mean(axis=0), abs=1e-9)
        assert np.ptp(np.linalg.norm(placed - placed.mean(axis=0), axis=1)) < 1e-9
        assert np.linalg.norm(placed[0] - placed[7]) == pytest.approx(np.linalg.norm(turns[0][0] - turns[0][7]))


@pytest.mark.parametrize("up", ["y", "z"])
def test_every_frame_holds_all_of_it_and_some_reach_the_border(up):
    views, report = run(rotate="0:360:24", up=up)
    assert list(views) == [(0, number) for number in range(24)]
    assert [view["yaw"] for view in report["views"]] == [15.0 * number for number in range(24)]
    shown = [picture.any(axis=2) for picture in views.values()]
    assert not any(picture[[0, -1]].any() or picture[:, [0, -1]].any() for picture in shown)
    spans = [picture.any(axis=0).sum() for picture in shown]
    assert max(spans) > 1.5 * min(spans)
    rows = {tuple(picture.any(axis=1)) for picture in shown}
    assert up == "z" or len(rows) == 1  # seen from the side, its height stays


def test_frames_of_a_part_of_a_turn_have_the_same_scale():
    """Both ends of this one show the box alike, but mirrored; what frames it isn't alike from there."""
    views, _ = run(rotate="-45:45:3", lenses="90x120")
    left, right = (views[0, number].any(axis=2) for number in (0, 2))
    assert np.array_equal(left[:, ::-1], right)


def test_a_full_turn_does_not_repeat_its_first_frame():
    full, _ = run(rotate="0:360:4")
    assert np.array_equal(full[0, 1][:, ::-1].any(axis=2), full[0, 3].any(axis=2))
    assert not np.array_equal(full[0, 0], full[0, 3])
    half, report = run(rotate="-45:45:3")
    assert [view["yaw"] for view in report["views"]] == [-45, 0, 45]
    assert len(half) == 3


def test_the_video_has_a_frame_for_each_yaw_and_may_be_saved_later(tmp_path):
    file = io.BytesIO()
    written, report = RUNS["reconstruction"](
        load_box(), Options.parse(SMALL | {"rotate": "0:360:6"}), Output(file, "mp4", 10**9, None, Clock())
    )
    assert (written, len(report["views"])) == ("mp4", 6)
    file.seek(0)
    with av.open(file) as container:
        assert container.streams.video[0].average_rate == 30
        assert len(list(container.decode(video=0))) == 6
    result = Reconstruction(*run(rotate="0:360:6"))
    result.save(tmp_path / "a.webp")
    assert (tmp_path / "a.webp").read_bytes().find(b"ANIM") > 0
    result.save(tmp_path / "frames")
    assert '"yaw": 300.0' in (tmp_path / "frames" / "report.json").read_text()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"time": "0,1"}, "rotate, time: 4 yaws and 2 times are given; give several of only one of the two"),
        ({"views": "cross"}, "rotate: 4 yaws make a video of one view, and 5 views .*; give .* or one yaw"),
        ({"source": LightField(np.zeros((3, 3, 30, 40, 3), np.uint8)), "pixels": "3x3"}, "rotate: this is for meshes"),
    ],
)
def test_what_makes_no_video_is_refused(wrong, message):
    with pytest.raises(InvalidOption, match=message):
        run(**{"rotate": "0:360:4"} | wrong)


def test_a_mesh_without_a_surface_is_read_once(monkeypatch):
    opened = []
    monkeypatch.setattr(Input, "open", lambda self, *given, _open=Input.open: opened.append(1) or _open(self, *given))
    flat = Bundle("flat.obj", "flat.obj", {"flat.obj": b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"}, Limits())
    with pytest.raises(NothingVisible, match="all 1 triangles have zero area"):
        run(flat, rotate="0:360:4")
    assert len(opened) == 1


def test_all_yaws_together_count():
    with pytest.raises(TooLarge, match="time, rotate: 4 frames are over the limit of 3"):
        run(load_box(views=3), rotate="0:360:4")
