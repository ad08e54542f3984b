import math

import pytest

from ciir.errors import BackendUnavailable
from ciir.service.pipeline import measuring


def test_what_one_more_costs():
    assert measuring.slope(10, 30, 100, 300) == pytest.approx(0.1)
    assert measuring.slope(30, 30, 100, 300) == pytest.approx(0.05)  # noise: half of the mean


@pytest.mark.parametrize(
    "measure",
    [
        measuring.rays_cost,
        measuring.opengl_cost,
        measuring.encoding_cost,
        lambda: measuring.network_cost("bicubic", 2, is_light_field=False),
    ],
)
def test_coefficients_are_positive(measure, monkeypatch):
    monkeypatch.setattr(measuring, "ENOUGH_MS", 0.0)
    try:
        found = measure()
    except BackendUnavailable as error:
        pytest.skip(str(error))
    assert all(math.isfinite(value) and value >= 0 for value in found)
    assert max(found) > 0


@pytest.fixture
def jobs(monkeypatch):
    """What makes a job of a time on the wall, one on all threads, and one on this; others have the cores in two rounds
    of three, and it takes twice as long."""
    now = {"wall": 0.0, "threads": 0.0, "this": 0.0}
    monkeypatch.setattr(measuring.time, "perf_counter", lambda: now["wall"])
    monkeypatch.setattr(measuring.time, "process_time", lambda: now["threads"])
    monkeypatch.setattr(measuring.time, "thread_time", lambda: now["this"])
    monkeypatch.setattr(measuring, "available_cores", lambda: 4)

    def made(name, wall, threads, this, runs):
        def run():
            runs.append(name)
            now["wall"] += wall * (1 if runs.count(name) % 3 == 0 else 2)
            now["threads"] += threads
            now["this"] += this

        return run

    return made


def test_what_other_processes_took_does_not_count(jobs):
    runs = []
    two, one = measuring.least(jobs("a", 0.01, 0.02, 0.002, runs), jobs("b", 0.03, 0.03, 0.03, runs))
    assert two == (pytest.approx(10), pytest.approx(2))
    assert one == (pytest.approx(30), pytest.approx(1))
    assert runs[:6] == ["a", "b"] * 3  # they take turns
    assert len(runs) >= 2 * measuring.ROUNDS + 2


def test_of_a_job_in_one_thread_that_thread_counts(jobs):
    (alone,) = measuring.least(jobs("a", 0.01, 0.07, 0.004, []), is_alone=True)  # others in this process are busy
    assert alone == (pytest.approx(4), 1.0)


def test_no_job_has_more_cores_than_there_are_or_less_than_one(jobs):
    wide, idle = measuring.least(jobs("a", 0.01, 0.08, 0, []), jobs("b", 0.1, 0.05, 0, []))
    assert (wide.cores, wide.ms) == (4, pytest.approx(20))
    assert (idle.cores, idle.ms) == (1, pytest.approx(50))
