"""A server of this checkout for hostile clients."""

from __future__ import annotations

import pytest

from tests.fuzz.over_http import list_deaths
from tests.support.servers import run_server


@pytest.fixture(scope="session")
def hostile_server(tmp_path_factory):
    """Yields a running server, which must stop in time and without a traceback.

    A display's picture of 11 million pixels is refused, because it is many seconds of work that no answer waits for.
    """
    folder = tmp_path_factory.mktemp("hostile")
    limits = {"CIIR_MAX_OUTPUT_PIXELS": "10000000"}
    with run_server(folder / "log", CIIR_FOLDER=str(folder / "service"), **limits) as server:
        yield server
    log = (folder / "log").read_text()
    assert "Traceback" not in log, log
    assert list_deaths(folder / "log") == []
