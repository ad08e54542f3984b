"""Fixtures for the tests of the pipeline."""

import pytest

from ciir.renderer.readers.bundle import Bundle
from tests.support.inputs import CUBE


@pytest.fixture
def cube():
    return Bundle.from_upload("cube.off", CUBE)
