"""Fixtures for the tests of the pipeline."""

import pytest

from ciir.renderer.readers.bundle import Bundle
from ciir.service.pipeline.planning import cost
from tests.support.inputs import CUBE


@pytest.fixture
def cube():
    return Bundle.from_upload("cube.off", CUBE)


@pytest.fixture
def instant(monkeypatch):
    """Makes jobs cost nothing besides their stages."""
    monkeypatch.setattr(cost, "JOB_MS", 0.0)
    monkeypatch.setattr(cost, "WRITE_MS", 0.0)
    monkeypatch.setattr(cost, "count_available_cores", lambda: 2)
