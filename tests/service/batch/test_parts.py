"""Light fields and videos that are made in parts."""

from __future__ import annotations

import json
from dataclasses import replace

import av
import numpy as np
import pytest

pytest.importorskip("fsspec")

from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.batch import parts
from ciir.service.batch.cuts import Cuts
from ciir.service.batch.task import Request, Task
from ciir.service.batch.work import work
from ciir.service.cli.main import main
from ciir.service.pipeline.options import Options
from tests.support.light_fields import make_views

FRAMES = 7


def run(task, request):
    """Runs the task and what follows from it, one after the other; returns all outcomes and that of the input."""
    waiting, cuts, outcomes, last = [task], Cuts(), [], None
    while waiting:
        task = waiting.pop(0)
        outcomes.append(work(task, request))
        following, last = cuts.follow(task, outcomes[-1])
        waiting += following
    return outcomes, last


@pytest.fixture(scope="module")
def light_field(tmp_path_factory):
    """A folder of 3x4 views of 16x16 pixels."""
    folder = tmp_path_factory.mktemp("views")
    views = make_views((3, 4), side=16, channels=3)
    for v, u in np.ndindex(3, 4):
        (folder / f"view_{v:02d}_{u:02d}.png").write_bytes(encode_png(views[v, u]))
    return folder


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A video of elemental image arrays of 16x16 lenses and 3x3 pixels, each brighter than the one before."""
    path = tmp_path_factory.mktemp("film") / "film.mkv"
    with av.open(str(path), "w") as file:
        stream = file.add_stream("ffv1", rate=5)
        stream.height, stream.width, stream.pix_fmt = 48, 48, "bgr0"
        for number in range(FRAMES):
            pixels = np.full((48, 48, 3), 20 * number + 10, np.uint8)
            pixels[:, 24:] += 5
            file.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        file.mux(stream.encode())
    return path


@pytest.mark.parametrize("name", ["out", "out.zip", "out.npz"])
def test_a_light_field_in_parts_is_that_of_reconstruct(light_field, tmp_path, monkeypatch, name):
    options = ("--views", "all", "--model", "field")
    assert main(["reconstruct", str(light_field), "-o", str(tmp_path / "whole" / name), *options]) == 0
    monkeypatch.setattr(parts, "PART_PIXELS", 5 * 32 * 32)
    request = Request(Options(views="all", model="field"), str(tmp_path))
    outcomes, last = run(Task(str(light_field), name, is_file="." in name), request)
    assert [outcome.status for outcome in outcomes] == ["cut", "done", "done", "done", "done"]
    assert (last.status, last.views, last.model) == ("done", 12, "field")
    whole, found = tmp_path / "whole" / name, tmp_path / name
    if found.is_dir():
        assert sorted(path.name for path in found.iterdir()) == sorted(path.name for path in whole.iterdir())
        assert all(path.read_bytes() == (whole / path.name).read_bytes() for path in found.glob("*.png"))
        reports = [json.loads((folder / "report.json").read_bytes()) for folder in (found, whole)]
        assert reports[0]["views"] == reports[1]["views"]
        assert reports[0]["options"] == reports[1]["options"]
    elif name.endswith(".npz"):
        with np.load(found) as one, np.load(whole) as other:
            assert all(np.array_equal(one[key], other[key]) for key in ("views", "positions"))
    assert list((tmp_path / ".batch" / "parts").iterdir()) == []
    assert [outcome.status for outcome in run(Task(str(light_field), name, is_file="." in name), request)[0]] == [
        "kept"
    ]


def test_the_report_of_parts_counts_the_input_of_all(light_field, tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "PART_PIXELS", 5 * 32 * 32)
    outcomes, _ = run(Task(str(light_field), "out"), Request(Options(views="all", model="none"), str(tmp_path)))
    assert len(outcomes) == 5
    found = json.loads((tmp_path / "out" / "report.json").read_bytes())["input"]
    sizes = [path.stat().st_size for path in light_field.iterdir()]
    assert (found["files"], found["bytes"]) == (12, sum(sizes))


@pytest.mark.parametrize("name", ["film.webm", "film.gif", "film"])
def test_frames_come_out_in_order(film, tmp_path, monkeypatch, name):
    monkeypatch.setattr(parts, "MOST_FRAMES", 3)
    request = Request(Options(lenses=(16, 16), model="none"), str(tmp_path))
    outcomes, last = run(Task(str(film), name, is_file="." in name, is_video=True), request)
    assert [outcome.status for outcome in outcomes] == ["cut", "done", "done", "done", "done"]
    assert (last.status, last.views) == ("done", FRAMES)
    if name == "film":
        pictures = [decode(path.read_bytes(), name=path.name) for path in sorted((tmp_path / name).glob("frame_*.png"))]
        views = json.loads((tmp_path / name / "report.json").read_bytes())["views"]
        assert [view["time"] for view in views] == pytest.approx([number / 5 for number in range(FRAMES)])
    else:
        with av.open(str(tmp_path / name)) as file:
            pictures = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
            assert name.endswith(".gif") or file.streams.video[0].average_rate == 5
    assert [round((picture[:, :4].mean() - 10) / 20) for picture in pictures] == list(range(FRAMES))


def test_frames_are_those_of_reconstruct(film, tmp_path):
    assert main(["reconstruct", str(film), "-o", str(tmp_path / "whole.png"), "--lenses", "16x16", "--frame", "4"]) == 0
    request = Request(Options(lenses=(16, 16)), str(tmp_path))
    _, last = run(Task(str(film), "film", is_video=True), request)
    assert last.status == "done"
    assert (tmp_path / "film" / "frame_0004.png").read_bytes() == (tmp_path / "whole.png").read_bytes()


def test_a_command_for_elemental_images_makes_every_frame(film, tmp_path):
    words = ["--arrangement", "eia", "--pixels", "3x3", "--model", "none", "--workers", "1", "--name", "{path}/"]
    assert main(["batch", str(film), "-o", str(tmp_path), *words]) == 0
    assert len(list((tmp_path / "film").glob("frame_*.png"))) == FRAMES


def test_a_video_is_of_one_view(film, tmp_path):
    request = Request(Options(lenses=(16, 16), views="all"), str(tmp_path))
    _, last = run(Task(str(film), "film.mp4", is_file=True, is_video=True), request)
    assert last.status == "failed"
    assert "9 are asked for" in last.error


@pytest.mark.parametrize("frame", ["", "4"])
def test_a_video_that_is_cut_off(film, tmp_path, frame):
    """Also where the frames are listed, before any is read."""
    (tmp_path / "short.mkv").write_bytes(film.read_bytes()[:100])
    options = Options(lenses=(16, 16), frame=int(frame or 0))
    _, last = run(Task(str(tmp_path / "short.mkv"), "film", is_video=not frame), Request(options, str(tmp_path)))
    assert last.status == "failed"
    assert last.error.endswith("short.mkv: damaged or cut off (while the video was read); send the whole file")


def test_a_part_that_fails_fails_the_whole(film, tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "MOST_FRAMES", 3)
    data = film.read_bytes()
    short = tmp_path / "short.mkv"
    short.write_bytes(data)
    request = Request(Options(lenses=(16, 16), model="none"), str(tmp_path))
    task = Task(str(short), "short.gif", is_file=True, is_video=True)
    first = work(task, request)
    short.write_bytes(data[: len(data) // 2])
    cuts = Cuts()
    following, last = cuts.follow(task, first)
    for part in following:
        more, last = cuts.follow(part, work(part, request))
        assert not more
    assert last.status == "failed"
    assert not (tmp_path / "short.gif").exists()


def test_parts_that_are_there_are_not_made_again(film, tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "MOST_FRAMES", 3)
    request = Request(Options(lenses=(16, 16), model="none"), str(tmp_path))
    task = Task(str(film), "film", is_video=True)
    first, *_ = parts.list_part_tasks(task, work(task, request).parts)
    assert work(first, request).status == "done"
    assert [outcome.status for outcome in run(task, request)[0]] == ["cut", "kept", "done", "done", "done"]


@pytest.mark.parametrize("damaged", ["report", "record"])
def test_a_damaged_part_fails_the_whole_once(film, tmp_path, monkeypatch, damaged):
    """Between the part and the join; the next run makes it anew."""
    monkeypatch.setattr(parts, "MOST_FRAMES", 3)
    request = Request(Options(lenses=(16, 16), model="none"), str(tmp_path))
    task = Task(str(film), "film", is_video=True)
    some = parts.list_part_tasks(task, work(task, request).parts)
    assert [work(part, request).status for part in some] == ["done"] * 3
    if damaged == "report":
        place = tmp_path / some[0].out / "report.json"
    else:
        (place,) = (path for path in (tmp_path / ".batch" / "records").iterdir() if some[0].out in path.read_text())
    place.write_bytes(place.read_bytes()[:50])
    failed = work(replace(task, joined=tuple(part.part for part in some)), request)
    assert failed.status == "failed"
    assert failed.error.count("\n") == 0
    assert "missing or damaged; run the batch again" in failed.error
    outcomes, last = run(task, request)
    assert [outcome.status for outcome in outcomes] == ["cut", "done", "kept", "kept", "done"]
    assert last.status == "done"
