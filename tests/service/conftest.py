"""Fixtures for all tests of the service."""

from __future__ import annotations

import pytest

from tests.support.inputs import CUBE, EIA_PNG
from tests.support.networks import install_stand_in
from tests.support.servers import run_server


@pytest.fixture(scope="session", autouse=True)
def cache_of_tests(tmp_path_factory):
    """Uses a separate cache folder, so that the user's is neither read nor written."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def stand_in(monkeypatch):
    return install_stand_in(monkeypatch)


@pytest.fixture
def cube_file(tmp_path):
    path = tmp_path / "cube.off"
    path.write_bytes(CUBE)
    return path


@pytest.fixture
def eia_file(tmp_path):
    path = tmp_path / "eia.png"
    path.write_bytes(EIA_PNG)
    return path


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    with run_server(
        tmp_path_factory.mktemp("server") / "log", CIIR_SYNC_SECONDS="60"
    ) as server:  # on a busy machine too
        yield server.url
