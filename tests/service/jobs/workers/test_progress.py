from ciir.service.jobs.workers import progress
from ciir.service.jobs.workers.progress import ProgressClock, read_progress


def test_each_stage_is_written_once_and_views_at_intervals(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    path = tmp_path / "progress"
    clock = ProgressClock(path)
    for stage in ("decode", "render", "encode", "render"):
        with clock.stage(stage):
            pass
    clock.count_views(1, 5)  # too soon
    now[0] += progress.VIEWS_SECONDS
    clock.count_views(3, 5)
    clock.count_views(4, 5)  # too soon
    clock.count_views(5, 5)  # the last is always written
    lines, offset = read_progress(path, 0)
    assert [(data["stage"], data["views_done"], data["views"]) for data in lines] == [
        ("decode", 0, 0),
        ("render", 0, 0),
        ("encode", 0, 0),
        ("encode", 3, 5),
        ("encode", 5, 5),
    ]
    assert offset == path.stat().st_size
    assert set(clock.timings_ms()) == {"decode", "render", "encode", "total"}


def test_progress_is_read_from_an_offset(tmp_path):
    path = tmp_path / "progress"
    assert read_progress(path, 0) == ([], 0)
    path.write_bytes(b'{"a":1}\n{"a"')
    assert read_progress(path, 0) == ([{"a": 1}], 8)
    assert read_progress(path, 8) == ([], 8)
    with path.open("ab") as file:
        file.write(b':2}\n{"a":3}\n')
    assert read_progress(path, 8) == ([{"a": 2}, {"a": 3}], 24)
