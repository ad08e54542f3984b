"""Work on an upload reads only the upload's own files and contacts no other machine, whatever the upload names."""

import base64
import json
import socket
import stat
import subprocess
import sys
import zipfile

import pytest

from ciir.renderer.writers.pictures import encode_png
from tests.fuzz import seeds
from tests.fuzz.seeds import gltf

pytestmark = pytest.mark.slow

PROGRAM = """
import json, sys
from pathlib import Path
from tests.fuzz.guard import Guard
from ciir.service.jobs.job import Problem, Request
from ciir.service.jobs.workers.task import TaskLimits, run_task
from ciir.service.settings import Settings

folder, allowed, statuses = Path(sys.argv[1]), TaskLimits.from_settings(Settings()), {}
guard = Guard(folder)
for is_armed in (False, True):  # what is imported late is by then
    for file in sorted((folder / "uploads").iterdir()):
        options = {"lenses": "1x1"} if file.suffix in {".png", ".tif", ".jpg"} else {"lenses": "8x8", "pixels": "3x3"}
        request = Request("upload" + file.suffix, options | {"model": "none", "backend": "raytrace"}, None)
        with file.open("rb") as source, (folder / "result").open("w+b") as target:
            if is_armed:
                guard.arm()
            outcome = run_task(request, source, target, allowed, lambda data: None).outcome
            guard.disarm()
        statuses[file.name] = outcome.status if isinstance(outcome, Problem) else 200
print(json.dumps([statuses, guard.seen]))
"""


def zip_with_link(target):
    import io

    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        link = zipfile.ZipInfo("a.png")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        archive.writestr(link, str(target))
    return buffer.getvalue()


def uploads(names, secret):
    """Files that name others: by URL, by absolute path, and by a path that leads out. Name -> (bytes, status)."""
    text, _, _ = seeds.parts(seeds.obj()[0])
    ply, _ = seeds.parts(seeds.ply()[0])
    made = {}
    for number, name in enumerate(names):
        encoded = name.encode()
        document = json.loads(seeds.parts(gltf.gltf()[1])[0])
        picture = json.loads(json.dumps(document))
        document["buffers"][0]["uri"] = name
        picture["images"][0]["uri"] = name
        made[f"buffer-{number}.gltf"] = json.dumps(document).encode(), 422
        made[f"image-{number}.gltf"] = json.dumps(picture).encode(), 200
        made[f"mtllib-{number}.obj"] = text.replace(b"a.mtl", encoded), 200
        library = b"newmtl m\nKd 1 1 1\nmap_Kd " + encoded + b"\nmap_d " + encoded + b"\n"
        made[f"map-{number}.zip"] = seeds.zipped({"a.obj": text, "a.mtl": library}), 200
        made[f"texture-{number}.ply"] = ply.replace(b"x.png", encoded), 200
        if not name.startswith("file"):
            made[f"member-{number}.zip"] = seeds.zipped({name: secret.read_bytes()}), 422
    svg = f'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b SYSTEM "file://{secret}">]><svg>&b;</svg>'.encode()
    pickled = base64.b64decode("gASVIQAAAAAAAACMBXBvc2l4lIwGc3lzdGVtlJOUjAZ0b3VjaCB4lIWUUpQu")  # os.system("touch x")
    return made | {
        "link.zip": (zip_with_link(secret), 415),
        "entity.png": (svg, 415),
        "entity.off": (svg, 415),
        "pickle.png": (pickled, 415),
        "exr.tif": (b"\x76\x2f\x31\x01" + bytes(60), 415),
        "pickle.zip": (seeds.zipped({"a.npy": b"\x93NUMPY\1\0" + pickled}), 422),
    }


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """The expected and the actual status of each upload, what the guard saw, and whether a connection came in."""
    outside, folder = tmp_path_factory.mktemp("outside"), tmp_path_factory.mktemp("work")
    secret = outside / "secret.png"
    secret.write_bytes(encode_png(seeds.noise(4, 4, 3)))
    (folder / "uploads").mkdir()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(0)
        url = f"http://127.0.0.1:{listener.getsockname()[1]}/secret.png"
        names = [url, f"//{url[7:]}", f"file://{secret}", str(secret), f"../../{outside.name}/secret.png"]
        made = uploads(names, secret)
        for name, (data, _) in made.items():
            (folder / "uploads" / name).write_bytes(data)
        command = [sys.executable, "-c", PROGRAM, str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own
        assert done.returncode == 0, done.stderr
        with pytest.raises(BlockingIOError):  # no connection came in
            listener.accept()
    statuses, seen = json.loads(done.stdout)
    return {name: status for name, (_, status) in made.items()}, statuses, seen


def test_every_upload_is_answered_as_if_what_it_names_were_not_there(outcome):
    expected, statuses, _ = outcome
    assert statuses == expected


def test_nothing_else_is_opened(outcome):
    _, _, seen = outcome
    assert seen == []
