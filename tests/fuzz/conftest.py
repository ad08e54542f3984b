"""A server of this clone for hostile clients."""

from __future__ import annotations

import pytest

from tests.fuzz.over_http import list_deaths
from tests.support.servers import run_server


@pytest.fixture(scope="session")
def hostile_server(tmp_path_factory):
    """A running server, which must stop in time and without a traceback."""
    folder = tmp_path_factory.mktemp("hostile")
    with run_server(folder / "log", CIIR_CACHE=str(folder / "cache")) as server:
        yield server
    log = (folder / "log").read_text()
    assert "Traceback" not in log, log
    assert list_deaths(folder / "log") == []
