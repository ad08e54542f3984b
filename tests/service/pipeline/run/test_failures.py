"""What of a run stays where a stage fails."""

import threading

import pytest

from ciir.service.pipeline import run as pipeline
from ciir.service.pipeline.options import Options
from ciir.service.pipeline.run import reconstruct
from ciir.service.pipeline.stages import schedule, view_sources
from tests.support.pipeline import SMALL, Recorder


def pipeline_threads():
    return [thread.name for thread in threading.enumerate() if thread.name.startswith(("views", "upscale"))]


@pytest.mark.parametrize("stage", ["render", "upscale", "encode", "progress"])
@pytest.mark.parametrize("turn", [0, 1, 14])
def test_the_first_error_ends_all_stages(cube, monkeypatch, stage, turn):
    """Each stage fails at a turn of one view; what comes before it was written, and nothing after."""
    monkeypatch.setattr(schedule, "BATCH_PIXELS", 1)
    seen = {"render": 0, "upscale": 0, "encode": 0, "progress": 0}

    def failing(name, call):
        def counted(*args, **kwargs):
            seen[name] += 1
            if name == stage and seen[name] == turn + 1:
                raise OSError(f"{name} {turn}")
            return call(*args, **kwargs)

        return counted

    monkeypatch.setattr(view_sources.MeshViews, "take_views", failing("render", view_sources.MeshViews.take_views))
    opened = pipeline.load_upscaler
    monkeypatch.setattr(pipeline, "load_upscaler", lambda *args, **kwargs: failing("upscale", opened(*args, **kwargs)))
    writer = Recorder()
    writer.write = failing("encode", writer.write)
    options = Options(views="all", model="bicubic", **SMALL)
    with pytest.raises(OSError, match=f"^{stage} {turn}$"):
        reconstruct(cube, options, writer, progress=failing("progress", lambda done, total: None))
    assert len(writer.views) == turn
    assert seen["render"] <= turn + 5  # no more were begun than wait in two queues
    assert writer.report is None
    assert pipeline_threads() == []


def test_of_two_errors_the_first_in_the_order_of_views_is_raised(cube, monkeypatch):
    monkeypatch.setattr(schedule, "BATCH_PIXELS", 1)
    rendered = threading.Event()
    take = view_sources.MeshViews.take_views

    def second_fails(self, pictures, count):
        if rendered.is_set():
            raise OSError("the second view")
        rendered.set()
        return take(self, pictures, count)

    monkeypatch.setattr(view_sources.MeshViews, "take_views", second_fails)
    writer = Recorder()

    def first_fails(view, pixels):
        raise OSError("the first view")

    writer.write = first_fails
    with pytest.raises(OSError, match="the first view"):
        reconstruct(cube, Options(views="all", model="bicubic", **SMALL), writer)
    assert pipeline_threads() == []
