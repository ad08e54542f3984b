"""The image alone: `docker run`, without rights and with nothing to write to but its volume and /tmp."""

import io

import numpy as np
import pytest
import tifffile

from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from tests.containers import docker
from tests.containers.object_store import run_store

LIMIT = 850e6
HARD = ("--read-only", "--tmpfs", "/tmp", "--cap-drop", "ALL", "--security-opt", "no-new-privileges")  # noqa: S108 - there


@pytest.fixture(scope="module")
def service(image):
    """(its URL, its id)."""
    port = docker.find_free_port()
    started = docker.run("docker", "run", "--detach", *HARD, "--publish", f"127.0.0.1:{port}:8000", image)
    try:
        docker.wait_for(lambda: docker.is_ready(f"http://127.0.0.1:{port}"), "it is ready")
        yield f"http://127.0.0.1:{port}", started
    finally:
        print(docker.run("docker", "logs", started))
        docker.run("docker", "rm", "--force", "--volumes", started)


def test_its_size(image):
    assert int(docker.inspect(image, "{{.Size}}")) < LIMIT


@pytest.mark.parametrize("package", ["torch", "pip", "matplotlib"])
def test_what_is_not_in_it(image, package):
    look = f"import importlib.util as u; print(u.find_spec({package!r}))"
    assert docker.run("docker", "run", "--rm", "--entrypoint", "python", image, "-c", look) == "None"


def test_a_user_without_rights_who_can_change_nothing(service):
    _, container = service
    assert docker.run_inside(container, "import os; print(os.getuid(), os.getgid())") == "10001 10001"
    assert docker.run_inside(container, "import os; print(os.statvfs('/opt/ciir').f_flag & os.ST_RDONLY)") == "1"
    rights = docker.run_inside(container, "print(*(line for line in open('/proc/1/status') if 'CapEff' in line))")
    assert int(rights.split()[1], 16) == 0


def test_its_health_is_reported(service):
    docker.wait_for(lambda: docker.inspect(service[1], "{{.State.Health.Status}}") == "healthy", "it is healthy")


@pytest.mark.parametrize("kind", ["png", "png16", "tiff"])
def test_pictures_come_through_its_decoders(service, kind):
    eia, data = docker.make_noise(24, 36, seed=1)
    if kind == "png16":
        eia = eia.astype(np.uint16) * 257
        data = encode_png(eia)
    elif kind == "tiff":
        file = io.BytesIO()
        tifffile.imwrite(file, eia, compression="zlib", photometric="rgb")
        data = file.getvalue()
    name = "eia.tif" if kind == "tiff" else "eia.png"
    answer = docker.post(service[0], data, name, lenses="6x9", views="1,2", model="none")
    assert answer.status_code == 200, answer.text
    assert np.array_equal(decode(answer.content, name="x"), eia[1::4, 2::4])


@pytest.mark.parametrize("backend", ["raster", "raytrace"])
def test_meshes_are_rendered(service, backend):
    cube = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
    answer = docker.post(service[0], cube, "cube.off", lenses="20x20", pixels="5x5", backend=backend)
    assert answer.status_code == 200, answer.text
    picture = decode(answer.content, name="x")
    assert picture.shape == (40, 40, 3)
    assert len(np.unique(picture)) > 2


def test_files_in_s3(image):
    eia, data = docker.make_noise(24, 36, seed=1)
    port = docker.find_free_port()
    with run_store() as (environment, objects):
        variables = [f"--env={name}={value}" for name, value in (environment | {"CIIR_FILES": "s3://b/c"}).items()]
        command = ("docker", "run", "--detach", "--network", "host", *HARD, *variables, image, "serve", "--port", port)
        started = docker.run(*command)
        try:
            docker.wait_for(lambda: docker.is_ready(f"http://127.0.0.1:{port}"), "it is ready")
            answer = docker.post(f"http://127.0.0.1:{port}", data, lenses="6x9", views="1,2", model="none")
            assert np.array_equal(decode(answer.content, name="x"), eia[1::4, 2::4])
            assert answer.content in list(objects.values())
        finally:
            docker.run("docker", "rm", "--force", "--volumes", started)


def test_nothing_is_sent_to_anyone(service):
    """onnxruntime would keep what it wants to send in the user's cache folder."""
    found = docker.run_inside(
        service[1], "import pathlib; print(*pathlib.Path('/var/lib/ciir').rglob('*onnxruntime*'))"
    )
    assert found == ""


def test_it_stops_on_sigterm(image):
    started = docker.run("docker", "run", "--detach", *HARD, image)
    try:
        docker.wait_for(
            lambda: "startup complete" in docker.run("sh", "-c", f"docker logs {started} 2>&1"), "it has started"
        )
        docker.run("docker", "stop", "--time", "60", started)
        assert docker.inspect(started, "{{.State.ExitCode}}") == "0"
    finally:
        docker.run("docker", "rm", "--force", "--volumes", started)
