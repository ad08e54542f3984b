"""docs/http.md: its examples run, and its tables agree with OpenAPI and the settings."""

import os
import re
import shutil
import subprocess
import sys
import zipfile

import httpx2
import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service.pipeline.options import KINDS
from tests.support.inputs import CUBE
from tests.support.paths import ROOT

TEXT = (ROOT / "docs" / "http.md").read_text(encoding="utf-8")
DEFAULT = "http://127.0.0.1:8000"


def find_code(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)


def run(folder, *command):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(  # noqa: S603 - our own
        command, cwd=folder, env=environment, check=False, text=True, capture_output=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done


def test_the_shell_examples(server, tmp_path):
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed here")
    script = "set -euo pipefail\n" + "".join(find_code("sh")).replace(DEFAULT, server)
    done = run(tmp_path, "bash", "-c", script)
    assert decode((tmp_path / "view.png").read_bytes(), name="x").shape == (100, 100, 3)
    assert decode((tmp_path / "eia.png").read_bytes(), name="x").shape == (450, 450, 3)
    assert decode((tmp_path / "vase.png").read_bytes(), name="x").shape == (50, 50, 3)
    assert decode((tmp_path / "large.png").read_bytes(), name="x").shape == (200, 200, 3)
    assert decode((tmp_path / "vase_plane.png").read_bytes(), name="x").shape == (50, 50, 3)
    assert (tmp_path / "again.pfm").read_bytes() == (tmp_path / "disparity.pfm").read_bytes()
    with zipfile.ZipFile(tmp_path / "views.zip") as archive:
        assert len(archive.namelist()) == 6
    unchanged, rest = done.stdout.split("\n", 1)
    assert unchanged == "304"
    assert not (tmp_path / "unchanged").exists() or not (tmp_path / "unchanged").read_bytes()
    assert re.findall(r"^event: (\w+)$", rest, re.MULTILINE)[-1] == "done"
    assert '"status":422' in rest
    assert '"state":"done"' in (tmp_path / "status.json").read_text()
    assert '{"status":"ready"}' in rest
    assert "ciir_queue_up 1.0" in (tmp_path / "metrics.txt").read_text()


def test_the_python_example(server, tmp_path):
    (tmp_path / "mesh.off").write_bytes(CUBE)
    (program,) = find_code("python")
    done = run(tmp_path, sys.executable, "-c", program.replace(DEFAULT, server))
    assert decode((tmp_path / "view.png").read_bytes(), name="x").shape == (100, 100, 3)
    assert np.load(tmp_path / "views.npz")["views"].shape == (25, 100, 100, 3)
    assert re.match(r"\(.*\)\nqueued {}", done.stdout)  # the notes, and the first event
    assert "scale: 9 is out of range" in done.stdout


def test_the_tables_agree_with_openapi(server):
    api = httpx2.get(f"{server}/openapi.json").json()
    routes = {
        (method.upper(), path): {int(status) for status in operation["responses"] if status != "default"}
        for path, item in api["paths"].items()
        for method, operation in item.items()
    }
    rows = re.findall(r"^\| `(GET|POST|DELETE) (/\S*)` \| ([\d ]+|as above) \|", TEXT, re.MULTILINE)
    named, above = {}, ""
    for method, path, statuses in rows:
        above = above if statuses == "as above" else statuses
        named[method, path] = set(map(int, above.split()))
    for kind in ("upscales", "elementals", "displays", "planes", "disparities", "inspections"):  # they have the same
        named |= {
            (method, path.replace("reconstructions", kind)): statuses
            for (method, path), statuses in named.items()
            if "{id}" in path and "reconstructions" in path
        }
    assert named == routes
    listed = {
        int(status)
        for cell in re.findall(r"^\| (\d{3}(?:, \d{3})*) \|", TEXT, re.MULTILINE)
        for status in cell.split(", ")
    }
    assert listed == {status for statuses in routes.values() for status in statuses if status >= 400}


@pytest.mark.parametrize("kind", ["upscale", "elemental"])
def test_the_options_of_each_kind_are_listed(kind):
    """Those of reconstructions are in /docs, which lists the options of `Kind` themselves."""
    (listed,) = re.findall(rf"`POST /v1/{kind}s` is `ciir .*?the options (?:are )?(.*?)\.\s", TEXT, re.DOTALL)
    assert sorted(re.findall(r"`(\w+)`", listed)) == sorted(KINDS[kind].options)


def test_metrics_and_settings_exist(server):
    metrics = httpx2.get(f"{server}/metrics").text
    for name in set(re.findall(r"`(ciir_[a-z_]+)`", TEXT)):
        assert re.search(rf"^# TYPE {name} ", metrics, re.MULTILINE), name
    settings = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    for name in set(re.findall(r"CIIR_[A-Z_]+", TEXT)):
        assert f"`{name}`" in settings, name
