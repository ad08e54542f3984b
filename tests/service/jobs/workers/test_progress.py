import threading
from concurrent.futures import ThreadPoolExecutor

from ciir.service.jobs.workers import progress
from ciir.service.jobs.workers.progress import ProgressClock


def test_the_stage_that_the_others_wait_for_is_reported():
    reported = []
    clock = ProgressClock(reported.append)
    with clock.stage("render"):
        with clock.stage("upscale"), clock.stage("encode"):
            pass
        with clock.stage("upscale"):
            pass
    with clock.stage("upscale"):
        with clock.stage("render"), clock.stage("encode"):
            pass
        with clock.stage("encode"):
            pass
    with clock.stage("encode"):
        pass
    assert [data["stage"] for data in reported] == ["render", "upscale", "render", "upscale", "encode"]


def test_stages_are_reported_when_they_change_and_views_at_intervals(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    reported = []
    clock = ProgressClock(reported.append)
    for stage in ("decode", "render", "render", "encode"):
        with clock.stage(stage):
            pass
    clock.count_views(1, 5)  # too soon
    now[0] += progress.VIEWS_SECONDS
    clock.count_views(3, 5)
    clock.count_views(4, 5)  # too soon
    clock.count_views(5, 5)  # the last is always reported
    assert [(data["stage"], data["views_done"], data["views"]) for data in reported] == [
        ("decode", 0, 0),
        ("render", 0, 0),
        ("encode", 0, 0),
        ("encode", 3, 5),
        ("encode", 5, 5),
    ]
    assert set(clock.timings_ms()) == {"decode", "render", "encode", "total"}


def test_two_threads_may_be_in_one_stage():
    reported, together = [], threading.Barrier(2)
    clock = ProgressClock(reported.append)

    def work(others):
        with clock.stage("map"):
            together.wait(5)
        others.wait(5)

    def work_on(others):
        with clock.stage("map"):
            together.wait(5)
            others.wait(5)  # the other one has left
            with clock.stage("upscale"):  # which is not the earliest
                pass

    with ThreadPoolExecutor(2) as pool:
        left = threading.Barrier(2)
        for future in [pool.submit(work, left), pool.submit(work_on, left)]:
            future.result(10)
    with clock.stage("encode"):
        pass
    assert [data["stage"] for data in reported] == ["map", "encode"]
