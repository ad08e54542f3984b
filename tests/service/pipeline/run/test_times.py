"""One view of a mesh at several times: framed alike, as frames of a video or as pictures."""

import io
import json
import weakref
import zipfile
from dataclasses import replace

import av
import numpy as np
import pytest

from ciir.errors import InvalidOption, NothingVisible, TooLarge
from ciir.renderer.limits import Limits
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.scene import Texture
from ciir.renderer.writers.file_writer import FileWriter
from ciir.renderer.writers.formats import FORMATS
from ciir.renderer.writers.writer import MemoryWriter
from ciir.service.interface import Reconstruction
from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.one_file import RUNS, Output
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.report import Clock
from ciir.service.pipeline.run import reconstruct
from tests.support.inputs import CUBE
from tests.support.meshes.gltf import SQUARE, Model

SMALL = {"lenses": (20, 48), "pixels": (3, 3), "model": "none", "backend": "raytrace"}
TIMES = (0.0, 0.25, 1.0)


def slide(**limits) -> Bundle:
    """The square, which moves by 4 of its sides to the right within a second."""
    model = Model()
    model.animate(0, "translation", [0, 1], np.array([[0, 0, 0], [4, 0, 0]], np.float32))
    return Bundle("a.glb", "a.glb", {"a.glb": model.glb()}, Limits(**limits))


def run(source=None, **options):
    writer = MemoryWriter()
    report = reconstruct(source or slide(), Options(**(SMALL | {"time": TIMES} | options)), writer)
    return writer.views, report


@pytest.mark.parametrize("read_again", [False, True])
def test_the_frame_stays_and_the_object_moves(read_again, monkeypatch):
    if read_again:
        monkeypatch.setattr(pipeline, "MOST_KEPT", 0)
    views, report = run()
    assert list(views) == [(0, 0), (0, 1), (0, 2)]
    assert [view["time"] for view in report["views"]] == list(TIMES)
    matrix = np.array(report["scene_transform"])
    columns = np.arange(48) - 23.5
    for time, picture in zip(TIMES, views.values(), strict=True):
        placed = (SQUARE + np.array([4 * time, 0, 0])) @ matrix[:3, :3].T + matrix[:3, 3]
        left, right = placed[:, 0].min(), placed[:, 0].max()
        assert picture.any(axis=(0, 2)).tolist() == ((columns > left) & (columns < right)).tolist()
    assert views[0, 0].any(axis=(0, 2))[:3].any()  # together they fill the width
    assert views[0, 2].any(axis=(0, 2))[-3:].any()


def test_meshes_are_kept_up_to_a_number_of_bytes_with_their_textures(monkeypatch):
    pixels = np.zeros((64, 64, 4), np.uint8)
    scenes, rendered = [], []

    def read(given, options):
        scene = load_textured(pixels.copy())
        scenes.append(weakref.ref(scene))
        return scene

    def load_textured(pixels):
        scene = inputs.read(slide())
        (part,) = scene.parts
        textured = replace(part, uv=np.zeros((len(part.vertices), 2), np.float32), texture=Texture(pixels))
        return replace(scene, parts=(textured,))

    def count(*given, **words):
        rendered.append(sum(scene() is not None for scene in scenes))
        return _reconstruct(*given, **words)

    _reconstruct = pipeline._reconstruct
    monkeypatch.setattr(pipeline.Input, "read_mesh", read)
    monkeypatch.setattr(pipeline, "_reconstruct", count)
    monkeypatch.setattr(pipeline, "MOST_KEPT", int(2.5 * pixels.nbytes))
    run(time=tuple(n / 10 for n in range(9)))
    assert max(rendered) <= 4  # two kept, the one that is rendered, the last one read


def grow(*, camera: bool = False) -> Bundle:
    """The square, whose sides grow from nothing, or which comes from behind a camera, within a second."""
    model = Model()
    path, values = ("translation", [[0, 0, 2], [0, 0, -2]]) if camera else ("scale", [[0, 0, 0], [1, 1, 1]])
    model.animate(0, path, [0, 1], np.array(values, np.float32))
    if camera:
        model.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
        model.json["nodes"].append({"camera": 0})
        model.json["scenes"] = [{"nodes": [0, len(model.json["nodes"]) - 1]}]
    return Bundle("a.glb", "a.glb", {"a.glb": model.glb()})


@pytest.mark.parametrize("backend", ["raster", "raytrace"])
@pytest.mark.parametrize("camera", [None, "0"])
def test_where_nothing_is_visible_the_background_is_drawn(backend, camera):
    source = grow(camera=camera is not None)
    views, report = run(source, time=(0.0, 1.0, 0.0), camera=camera, backend=backend, background=(10, 20, 30))
    is_background = [(picture == (10, 20, 30)).all() for picture in views.values()]
    assert is_background == [True, False, True]
    assert report["input"]["triangles"] == 2
    noted = "time: nothing of the mesh is visible at 2 of 3 times, the first 0 s; only the background is drawn then"
    assert [note for note in report["notes"] if "camera" not in note] == [noted]
    with pytest.raises(NothingVisible, match="give another time than 0"):
        run(source, time=(0.0, 0.0), camera=camera)


def test_too_many_pixels_are_refused_before_the_poses_are_read(monkeypatch):
    monkeypatch.setattr(pipeline.Input, "read_mesh", pytest.fail)
    with pytest.raises(TooLarge, match="3 views of 20x48 pixels: 2,880 are over the limit of 2,000"):
        reconstruct(slide(), Options(**SMALL, time=TIMES), MemoryWriter(), max_pixels=2000)


def test_a_cameras_framing_is_that_of_all_times_in_any_order():
    model = Model()
    model.animate(0, "translation", [0, 1], np.array([[0, 0, -10], [0, 0, -2]], np.float32))
    model.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
    model.json["nodes"].append({"camera": 0})
    model.json["scenes"] = [{"nodes": [0, len(model.json["nodes"]) - 1]}]
    source = Bundle("a.glb", "a.glb", {"a.glb": model.glb()})
    forth, back = ([*run(source, time=times, camera="0")[0].values()] for times in ((0.0, 1.0), (1.0, 0.0)))
    assert np.array_equal(forth, back[::-1])


def test_strategy_and_model_are_selected_once():
    views, report = run(model="fast", strategy="auto", scale=2, time=(0.0, 0.5))
    assert [picture.shape for picture in views.values()] == [(40, 96, 3)] * 2
    assert report["plan"]["strategy"] in {"upscale", "direct"}


@pytest.mark.parametrize("name", ["mp4", "webm", "gif", "animated-webp", None])
def test_each_format_has_a_frame_for_each_time(name):
    file, progress = io.BytesIO(), []
    options = Options.parse({"time": "0:1:5", "lenses": "20x48", "pixels": "3x3", "model": "none"})
    output = Output(file, name, 10**9, lambda *done: progress.append(done), Clock())
    written, report = RUNS["reconstruction"](slide(), options, output)
    assert len(report["views"]) == 5
    assert progress == [(number, 5) for number in range(6)]
    file.seek(0)
    if name is None:
        assert written == "zip"
        with zipfile.ZipFile(file) as archive:
            assert archive.namelist() == [*(f"frame_{number:04d}.png" for number in range(5)), "report.json"]
            assert [view["time"] for view in json.loads(archive.read("report.json"))["views"]] == [
                0,
                0.25,
                0.5,
                0.75,
                1,
            ]
        return
    if name == "animated-webp":
        return
    with av.open(file) as container:
        assert float(container.streams.video[0].average_rate) == pytest.approx(4, rel=0.01)  # as the times pass
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    left = [int((frame.max(axis=(0, 2)) > 60).argmax()) for frame in frames]
    assert left == sorted(left)
    assert left[-1] > left[0] + 30


def test_formats_of_light_fields_refuse_times():
    for name in set(FORMATS) - {"mp4", "webm", "gif", "animated-webp", "zip"}:
        with (
            FileWriter(io.BytesIO(), name) as writer,
            pytest.raises(InvalidOption, match=r"no pictures at several times or yaws; give .*, animated-webp or zip$"),
        ):
            reconstruct(slide(), Options(**SMALL, time=TIMES), writer)


def test_the_python_interface_saves_a_video(tmp_path):
    views, report = run(time=(0.0, 1.0))
    result = Reconstruction(views, report)
    result.save(tmp_path / "a.webp")
    assert (tmp_path / "a.webp").read_bytes().find(b"ANIM") > 0
    result.save(tmp_path / "frames")
    assert (tmp_path / "frames" / "frame_0001.png").exists()


def test_what_makes_no_video_is_refused():
    for wrong, message in (
        ({"views": "cross"}, "3 times make a video of one view, and 5 views are asked for"),
        ({"animation": "Run"}, "animation: 'Run' is not in a.glb; give 0"),
        ({"source": Bundle("a.off", "a.off", {"a.off": CUBE})}, "these apply only to glTF files"),
        ({"source": "vase"}, "holds no animations and no cameras"),
        ({"time": None, "animation": "0"}, "animation: '0' is shown at a time; give time, too"),
    ):
        with pytest.raises(InvalidOption, match=message):
            run(**wrong)
    with (
        FileWriter(io.BytesIO(), "mp4", Options(path="sweep").make_writer_options()) as writer,
        pytest.raises(InvalidOption, match="path, frames: with several times or yaws, each is a frame"),
    ):
        reconstruct(slide(), Options(**SMALL, time=TIMES), writer)


def test_all_times_together_count():
    with pytest.raises(TooLarge, match="time, rotate: 3 frames are over the limit of 2"):
        run(slide(views=2))
    options = Options(**SMALL, time=TIMES)
    reconstruct(slide(), options, MemoryWriter(), max_pixels=3 * 20 * 48)
    with pytest.raises(TooLarge, match="over the limit of 2,879"):
        reconstruct(slide(), options, MemoryWriter(), max_pixels=3 * 20 * 48 - 1)
    lenslets = Options(**SMALL, time=TIMES, sampling="lenslet")
    with pytest.raises(TooLarge, match="3 views of 15,360 samples each are 46,080, over the limit of 46,079"):
        reconstruct(slide(), lenslets, MemoryWriter(), max_pixels=3 * 20 * 48 * 16 - 1)


def test_a_note_that_differs_in_its_numbers_alone_comes_once():
    _, report = run(time=(2.0, 3.0), background=(229, 229, 229))
    assert report["notes"][0] == "time: the animation ends at 1 s; its last pose is shown"
    assert len(report["notes"]) <= 2
