"""The web process loads no library that only workers need, and stays small."""

import platform
from pathlib import Path

import httpx2
import pytest

from ciir.renderer.writers.pictures import encode_png
from tests.support.inputs import make_picture
from tests.support.servers import run_server

pytestmark = pytest.mark.slow

MAX_MIB = 150
"""Resident memory of the web process without workers."""
HEAVY = ("onnxruntime", "embree", "libEGL", "OpenGL", "PIL/", "imagecodecs", "trimesh", "DracoPy")


@pytest.mark.skipif(platform.system() != "Linux", reason="reads /proc")
def test_the_web_process_stays_small(tmp_path):
    log = tmp_path / "log"
    with run_server(log, CIIR_WORKERS="0", CIIR_FOLDER=str(tmp_path / "jobs")) as server:
        for number in range(20):
            response = httpx2.post(
                f"{server.url}/v1/reconstructions",
                files={"file": (f"{number}.png", encode_png(make_picture(200, 200, seed=number)))},
                data={"lenses": "50x50"},
                headers={"Prefer": "respond-async"},
            )
            assert response.status_code == 202, response.text
        for path in ("/docs", "/openapi.json", "/v1/models", "/metrics", "/readyz"):
            assert httpx2.get(server.url + path).status_code == 200
        web = Path("/proc", str(server.pid))
        status = (web / "status").read_text()
        mapped = (web / "maps").read_text()
    resident = int(status.partition("VmRSS:")[2].split()[0]) / 1024
    assert resident < MAX_MIB, f"{resident:.0f} MiB"
    assert [name for name in HEAVY if name in mapped] == []
