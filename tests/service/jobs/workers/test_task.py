"""Tasks run in this process, without its restrictions."""

import errno
import io
from dataclasses import replace

import pytest

from ciir.models import catalogue, processor
from ciir.models.single.network import SingleImageNetwork
from ciir.service.jobs.job import Problem, Request
from ciir.service.jobs.workers.sandbox import restrictions
from ciir.service.jobs.workers.task import TaskLimits, _is_out_of_memory, run_task, warm_up
from ciir.service.pipeline import run
from ciir.service.settings import Settings
from tests.support.inputs import CUBE

FAST = {"lenses": "12x10", "pixels": "3x3", "model": "none", "backend": "raytrace"}


@pytest.fixture(autouse=True)
def leave_this_process_unrestricted(monkeypatch):
    monkeypatch.setattr(restrictions, "allow_cpu", lambda seconds: None)


@pytest.fixture
def given(tmp_path):
    with io.BytesIO(CUBE) as source, (tmp_path / "result").open("w+b") as target:
        yield Request("upload.off", FAST, None), source, target


def run_here(given, **settings):
    return run_task(*given, TaskLimits.from_settings(Settings(**settings)), lambda data: None)


@pytest.mark.parametrize(("views", "count"), [("center", 1), ("all", 9)])
def test_a_result_has_the_number_of_its_views(given, views, count):
    request, *files = given
    result = run_here((replace(request, options=FAST | {"views": views}), *files)).outcome
    assert result.views == count
    assert "views" not in result.report


def raise_error(error):
    def fail(*args, **options):
        raise error

    return fail


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"max_triangles": 11}, "12 triangles"),
        ({"max_output_pixels": 119}, "over the limit of 119"),
    ],
)
def test_limits_of_the_settings_apply(given, settings, words):
    outcome = run_here(given, **settings).outcome
    assert isinstance(outcome, Problem)
    assert outcome.status == 413
    assert words in outcome.detail


@pytest.mark.parametrize(
    ("error", "words", "expected"),
    [
        (OSError(errno.EFBIG, "x"), "the result is over 2,147,483,648 bytes", (413, False)),
        (OSError(errno.ENOSPC, "x"), "disk is full", (503, False)),
        (OSError(errno.EDQUOT, "x"), "disk is full", (503, False)),
        (OSError(errno.ENOMEM, "x"), "4,294,967,296 bytes of memory", (413, True)),
        (MemoryError(), "bytes of memory; give", (413, True)),
        (Exception("Failed to allocate memory for requested buffer"), "bytes of memory", (413, True)),
    ],
)
def test_a_lack_of_memory_or_disk_space_is_a_problem(given, monkeypatch, error, words, expected):
    monkeypatch.setattr(run, "reconstruct", raise_error(error))
    found = run_here(given)
    assert (found.outcome.status, found.is_out_of_memory) == expected
    assert words in found.outcome.detail


@pytest.mark.parametrize("error", [OSError(errno.EIO, "x"), RuntimeError("x"), KeyError("x")])
def test_other_errors_are_raised(given, monkeypatch, error):
    monkeypatch.setattr(run, "reconstruct", raise_error(error))
    with pytest.raises(type(error)):
        run_here(given)


def test_a_lack_of_memory_is_found_in_messages_and_causes():
    assert _is_out_of_memory(RuntimeError("std::bad_alloc"))
    assert not _is_out_of_memory(RuntimeError("anything else"))
    later = ValueError("too large")
    assert not _is_out_of_memory(later)
    later.__cause__ = MemoryError()
    assert _is_out_of_memory(later)


def test_warm_up_runs_both_models_of_auto(stand_in, monkeypatch):
    ran = []

    def noted(load):
        return lambda name, **options: ran.append(name) or load(name, **options)

    for loader in ("load_upscaler", "load_light_field_network"):
        monkeypatch.setattr(catalogue, loader, noted(getattr(catalogue, loader)))
    call = type(stand_in).__call__
    monkeypatch.setattr(type(stand_in), "__call__", lambda *given, **more: ran.append("ran") or call(*given, **more))
    warm_up()
    assert set(ran) == {"field", "quality", "ran"}


@pytest.mark.usefixtures("stand_in")
@pytest.mark.skipif(processor.int8_unsupported_reason() != "", reason=processor.int8_unsupported_reason())
@pytest.mark.parametrize("cores", [2, 5])
def test_warm_up_opens_the_sessions_of_one_picture_and_of_many(cores, monkeypatch):
    fresh = SingleImageNetwork(catalogue.SHIPPED / "fast-int8.json", threads=cores)
    monkeypatch.setattr(catalogue, "load_upscaler", lambda name, scale=2: fresh)
    monkeypatch.setattr("ciir.cores.count_available_cores", lambda: cores)
    opened = []
    get_session = fresh._get_session
    monkeypatch.setattr(fresh, "_get_session", lambda number: opened.append(number) or get_session(number))
    warm_up()
    assert set(opened) == {1, cores}
