import pytest

from tests.support.inputs import EIA_PNG
from tests.support.web import run_app


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with run_app(tmp_path_factory.mktemp("service")) as client:
        yield client


@pytest.fixture
def own(tmp_path):
    """Yields the client of a server that no other test uses."""
    with run_app(tmp_path) as client:
        yield client


@pytest.fixture
def eia():
    return EIA_PNG
