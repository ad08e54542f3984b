"""A full disk, and folders that are removed while the service runs."""

import os
import re
import shutil
import subprocess
from types import SimpleNamespace

import httpx2
import pytest

from ciir.errors import InvalidOption, NoRoom, QueueUnavailable
from ciir.service.jobs.disk import Disk
from ciir.service.jobs.jobs import Jobs
from ciir.service.settings import Settings
from tests.support.inputs import EIA_PNG
from tests.support.servers import run_server
from tests.support.web import check_problem, post_file, run_app

pytestmark = pytest.mark.slow

FIELDS = {"lenses": "6x9", "model": "none"}
POST = "/v1/reconstructions"


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 8 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(command, capture_output=True, check=False).returncode:  # noqa: S603 - our own
        pytest.skip("a small file system can't be mounted here: that takes root and its capabilities")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)  # noqa: S603, S607


def fill(folder):
    """Fills a file system to the last byte."""
    with (folder / "filler").open("wb", buffering=0) as file:
        for size in (4096, 1):
            try:
                while file.write(bytes(size)):
                    pass
            except OSError:
                continue


def test_a_full_disk_refuses_new_work_and_serves_kept_results(small_disk):
    with run_app(small_disk / "service", max_body_bytes=1 << 20) as client:
        kept = post_file(client, data=EIA_PNG, **FIELDS)
        assert kept.status_code == 200
        place = kept.headers["content-location"]
        fill(small_disk)
        check_problem(client.get("/readyz"), 503, "1,048,576 bytes left", "free disk space")
        for again in (client.get(place), post_file(client, data=EIA_PNG, **FIELDS)):
            assert (again.status_code, again.content) == (200, kept.content)
        refused = post_file(client, data=EIA_PNG, lenses="6x9", model="bicubic")
        check_problem(refused, 503, "the server's disk is full", "free disk space")
        assert refused.json()["type"] == client.get("/readyz").json()["type"] == "urn:ciir:no-room"
        client.pool.ready = False  # as while workers can't be started
        check_problem(client.get("/readyz"), 503, "the server's disk is full")
        client.pool.ready = True
        assert refused.headers["retry-after"] == "1"
        assert client.get("/metrics").status_code == client.get("/healthz").status_code == 200
        (small_disk / "filler").unlink()
        assert client.get("/readyz").status_code == 200
        assert post_file(client, data=EIA_PNG, lenses="6x9", model="bicubic").status_code == 200


@pytest.mark.parametrize("is_new", [True, False])
def test_a_server_does_not_start_on_a_full_disk(small_disk, is_new):
    folder = small_disk / "service"
    if not is_new:
        Jobs(Settings(folder=folder)).close()
    fill(small_disk)
    with pytest.raises(InvalidOption, match=r"the disk is full; free disk space there, or name another folder$"):
        Jobs(Settings(folder=folder)).close()


def test_a_full_disk_is_freed_by_removing_jobs(small_disk):
    with run_app(small_disk / "service", max_body_bytes=1 << 20) as client:
        kept = post_file(client, data=EIA_PNG, lenses="6x9", model="none", views="all", format="npz")
        place = kept.headers["content-location"].removesuffix("/result")
        fill(small_disk)
        assert client.delete(place).status_code == 200
        assert client.get(place).status_code == 404
        assert not list((small_disk / "service/files/results").iterdir())


def test_a_full_disk_is_logged_once(tmp_path, monkeypatch, caplog):
    (tmp_path / "db").touch()
    disk = Disk([tmp_path], tmp_path / "db", 100)
    disk.check()
    found = SimpleNamespace(f_flag=0, f_bavail=9, f_frsize=10, f_files=5, f_favail=5)
    monkeypatch.setattr(os, "statvfs", lambda folder: found)
    for _ in range(3):
        with pytest.raises(NoRoom, match="less than 100 bytes left"):
            disk.check()
    found.f_bavail = 10
    disk.check()
    assert [len(re.findall(text, caplog.text)) for text in ("100 bytes left", "can be used again")] == [1, 1]
    found.f_favail = 0
    with pytest.raises(NoRoom, match="free disk space"):
        disk.check()
    found.f_files = 0  # a file system that doesn't count files
    disk.check()
    found.f_flag = os.ST_RDONLY
    with pytest.raises(QueueUnavailable, match="can't be written"):
        disk.check()
    monkeypatch.undo()
    (tmp_path / "other").touch()
    (tmp_path / "other").replace(tmp_path / "db")
    with pytest.raises(QueueUnavailable, match="removed or replaced"):
        disk.check()


def test_a_server_whose_folder_is_removed_answers_503(tmp_path):
    folder = tmp_path / "service"
    with run_server(tmp_path / "log", CIIR_WORKERS="1") as server, httpx2.Client(base_url=server.url) as client:
        kept = post_file(client, data=EIA_PNG, **FIELDS)
        place = kept.headers["content-location"]
        job = place.removesuffix("/result")
        shutil.rmtree(folder.rename(tmp_path / "removed"))  # renamed first: a worker may still tidy files up in it
        for is_back in (False, True):
            if is_back:
                for name in ("inputs", "results", "runs"):
                    (folder / "files" / name).mkdir(parents=True)
            for response in (client.get("/readyz"), post_file(client, data=EIA_PNG, lenses="6x9", model="bicubic")):
                check_problem(response, 503, "start the server again")
            assert post_file(client, data=EIA_PNG, **FIELDS).status_code == 503
            for response in (client.get(job), client.get(place), client.delete(job), client.get(f"{job}/events")):
                assert response.status_code in (200, 204, 404, 410, 503)
            assert client.get("/metrics").status_code == client.get("/healthz").status_code == 200
    assert "Traceback" not in (tmp_path / "log").read_text()
