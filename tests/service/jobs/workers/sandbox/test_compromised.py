"""A worker process of a real `ciir serve` that runs what an upload contains, as after a bug in a decoder."""

import json
import os
import platform
import shlex
import shutil
import socket
import stat
import sys
import tempfile
import textwrap
from pathlib import Path

import httpx2
import pytest

from ciir.service.jobs.workers.sandbox import seccomp
from tests.load.server import descendants
from tests.support.inputs import CUBE
from tests.support.paths import ROOT
from tests.support.servers import run_server

pytestmark = pytest.mark.skipif(
    platform.system() != "Linux" or platform.machine() not in seccomp._ARCHITECTURES, reason="the sandbox is Linux's"
)
MARK = b"# code\n"
HOLE = f"""
import importlib.util, sys

class Hole:
    def find_spec(self, name, path, target=None):
        if name != "ciir.renderer.readers.bundle" or "serve" in sys.argv:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        load = spec.loader.exec_module
        def exec_module(module):
            load(module)
            read = module.Bundle.from_upload
            def from_upload(name, data, *more):
                exec(data.partition({MARK!r})[2], {{}})
                return read(name, data, *more)
            module.Bundle.from_upload = from_upload
        spec.loader.exec_module = exec_module
        return spec

sys.meta_path.insert(0, Hole())
"""
"""Runs in each Python of the server as it starts; makes worker processes execute what follows `MARK`."""
SECRETS = {
    "CIIR_API_KEYS": "swordfish",
    "AWS_SECRET_ACCESS_KEY": "swordfish",
    "OTEL_EXPORTER_OTLP_HEADERS": "key=swordfish",
}
KEY = {"X-API-Key": "swordfish"}


@pytest.fixture
def folder():
    """A folder that any user may use."""
    made = Path(tempfile.mkdtemp(prefix="ciir-"))
    made.chmod(0o777)
    (made / "site").mkdir()
    (made / "site" / "sitecustomize.py").write_text(HOLE)
    (made / "secret").write_text("of the user")
    yield made
    shutil.rmtree(made)


def become_nobody(folder):
    """Commands by which root starts a program as a user without rights who can read this Python."""
    if os.getuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("needs root, and setpriv of util-linux")
    private = [path for path in (ROOT, *ROOT.parents) if not path.stat().st_mode & stat.S_IXOTH]
    if private:
        pytest.skip(f"other users can't enter {private[0]}, which this checkout is in")
    (folder / "python").mkdir()
    base = Path(sys.base_prefix).resolve()
    closed = [path for path in reversed(base.parents) if not path.stat().st_mode & stat.S_IXOTH]
    steps = []
    if closed:  # such as /root: in a view of its own, empty but for Python
        hidden, python = shlex.quote(str(closed[0])), shlex.quote(str(base))
        kept = shlex.quote(str(folder / "python"))
        steps = [
            f"mount --bind {python} {kept}",
            f"mount -t tmpfs -o mode=755 none {hidden}",
            f"mkdir -p {python}",
            f"mount --bind {kept} {python}",
        ]
    program = 'exec setpriv --reuid=65534 --regid=65534 --clear-groups --inh-caps=-all "$@"'
    return f'exec unshare --mount sh -ec {shlex.quote("; ".join([*steps, program]))} sh "$@"'


@pytest.mark.parametrize("user", ["this", "nobody"])
def test_a_compromised_worker_reaches_nothing_else(folder, user):
    setup = become_nobody(folder) if user == "nobody" else ""
    environment = SECRETS | {
        "CIIR_FOLDER": str(folder / "service"),
        "CIIR_WORKERS": "2",
        "HOME": str(folder),
        "PYTHONPATH": os.pathsep.join([str(folder / "site"), str(ROOT)]),
    }
    datagrams = str(folder / "datagrams")
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver,
        run_server(folder / "log", setup=setup, **environment) as server,
        httpx2.Client(base_url=server.url, headers=KEY, timeout=30) as client,
    ):
        receiver.bind(datagrams)
        Path(datagrams).chmod(0o777)
        fields = {"lenses": "12x10", "pixels": "3x3", "model": "none", "backend": "raytrace"}
        response = client.post("/v1/reconstructions", files={"file": ("a.off", CUBE)}, data=fields)
        assert response.status_code == 200, response.text
        result = response.content
        place = response.headers["content-location"]
        (stored,) = (folder / "service" / "files" / "results").iterdir()
        family = descendants(server.pid)
        assert len(family) == 3
        for pid in family:
            status = Path(f"/proc/{pid}/status").read_text()
            assert f"\nUid:\t{65534 if user == 'nobody' else os.getuid()}\t" in status
            assert "swordfish" not in read_environment(pid)
            assert pid == server.pid or "\nCapPrm:\t0000000000000000\n" in status
        given = {
            "folder": str(folder / "service"),
            "result": str(stored),
            "port": listener.getsockname()[1],
            "datagrams": datagrams,
            "sibling": max(family),
        }
        code = f"ATTACK = {given!r}\n" + (ROOT / "tests/support/workers/attack.py").read_text()
        response = client.post("/v1/reconstructions", files={"file": ("b.off", attack(code))}, data=fields)
        assert response.status_code == 422, response.text
        found = json.loads(response.json()["detail"].partition("FOUND")[2])
        assert {name: outcome for name, outcome in found.items() if outcome != "refused"} == {}
        assert len(found) > 50
        assert client.get(f"{place.removesuffix('/result')}/result").content == result


def read_environment(pid):
    """The environment that a process was started with; empty where only root may read it."""
    try:
        return Path(f"/proc/{pid}/environ").read_text()
    except PermissionError:
        return ""


def attack(code):
    """An upload with code."""
    return CUBE + MARK + textwrap.dedent(code).encode()
