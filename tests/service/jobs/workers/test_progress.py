from ciir.service.jobs.workers import progress
from ciir.service.jobs.workers.progress import ProgressClock


def test_each_stage_is_reported_once_and_views_at_intervals(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    reported = []
    clock = ProgressClock(reported.append)
    for stage in ("decode", "render", "encode", "render"):
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
