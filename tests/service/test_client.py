"""The clients against a real server."""

import asyncio
import io

import numpy as np
import pytest

from ciir.errors import (
    ConnectionFailed,
    InvalidOption,
    NotFound,
    ResultExpired,
    Unreadable,
    UnsupportedType,
)
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service import client as client_module
from ciir.service.client import AsyncClient, Client, Result
from tests.support.inputs import CUBE, EIA

JOB = f"/v1/reconstructions/{'0' * 32}"
FIELDS = {"lenses": "6x9", "model": "none"}


@pytest.fixture
def client(server):
    with Client(server) as client:
        yield client


def test_a_result(client, eia_file, tmp_path):
    result = client.reconstruct(eia_file, views="1,2", scale=None, **FIELDS)
    assert np.array_equal(decode(result.content, name="x"), EIA[1::4, 2::4])
    assert (result.format, len(result.id)) == ("png", 32)
    assert result.timings_ms["total"] > 0
    assert result.notes == ()
    result.save(tmp_path / "view.png")
    assert (tmp_path / "view.png").read_bytes() == result.content
    result.save(tmp_path)
    assert (tmp_path / f"{result.id}.png").read_bytes() == result.content


def test_the_content_of_a_file_and_open_files(client, server, eia_file, tmp_path):
    whole = client.reconstruct(eia_file, **FIELDS)
    mesh = tmp_path / "mesh.off"
    mesh.write_bytes(CUBE)
    with eia_file.open("rb") as file, mesh.open("rb") as other:
        for source in (
            eia_file.read_bytes(),
            memoryview(eia_file.read_bytes()),
            file,
            io.BytesIO(eia_file.read_bytes()),
            EIA,
        ):
            assert client.reconstruct(source, **FIELDS).content == whole.content
        assert not file.closed
        assert client.submit(other, lenses="5x5").result().id == client.reconstruct(mesh, lenses="5x5").id

    async def run():
        async with AsyncClient(server) as other:
            return (await other.reconstruct(io.BytesIO(eia_file.read_bytes()), **FIELDS)).content

    assert asyncio.run(run()) == whole.content
    for wrong, text in (([EIA], "a path, a file, bytes or a NumPy array is needed, not list"), (None, "not NoneType")):
        with pytest.raises(InvalidOption, match=text):
            client.reconstruct(wrong, **FIELDS)
    with eia_file.open("r", encoding="latin-1") as file, pytest.raises(InvalidOption, match="open it with mode 'rb'"):
        client.reconstruct(file, **FIELDS)


def test_a_job(client, eia_file):
    job = client.submit(eia_file, views="all", format="npz", **FIELDS)
    events = list(job.events())
    assert [event.number for event in events] == list(range(len(events)))
    assert (events[0].kind, events[-1].kind) == ("queued", "done")
    result = job.result()
    assert (result.id, result.format) == (job.id, "npz")
    assert np.load(io.BytesIO(result.content))["views"].shape == (16, 6, 9, 3)
    assert job.status()["state"] == "done"
    assert job.status()["report"]["plan"]["model"] == "none"
    assert client.reconstruct(eia_file, views="all", format="npz", **FIELDS).content == result.content
    assert job.cancel()["state"] == "done"
    with pytest.raises(NotFound):  # it had ended, and so it was removed
        job.status()


def test_errors_are_raised_by_class(client, eia_file, tmp_path):
    (tmp_path / "notes.txt").write_bytes(b"hello")
    with pytest.raises(UnsupportedType, match=r"^upload\.txt"):
        client.reconstruct(tmp_path / "notes.txt")
    with pytest.raises(InvalidOption, match="5x9"):
        client.submit(eia_file, lenses="5x9").result()
    with pytest.raises(InvalidOption, match="lense"):
        client.submit(eia_file, lense="6x9")
    with pytest.raises(InvalidOption, match="views"):
        client.upscale(eia_file, views="all")  # not an option of that kind
    for method in ("status", "result", "cancel"):
        with pytest.raises(NotFound):
            getattr(client_module.Job(client, JOB), method)()
    with pytest.raises(Unreadable, match=r"gone\.png: No such file"):
        client.reconstruct(tmp_path / "gone.png")
    with pytest.raises(InvalidOption, match=r"^scene: no 'cup' here; give one of vase, globe, hamburger$"):
        client.reconstruct("scene:cup")
    with pytest.raises(ConnectionFailed, match=r"begins with http:// or https://$"):
        client_module.Client("localhost:8000", retries=0).models()


def test_a_shipped_scene(client):
    scene = client.reconstruct("scene:vase", lenses=(8, 6), pixels=(3, 3), model="none")
    assert decode(scene.content, name="x").shape == (8, 6, 3)


def test_the_other_kinds(client, eia_file, cube_file, tmp_path):
    height, width = EIA.shape[:2]
    large = client.upscale(eia_file, model="bicubic", scale=3)
    assert decode(large.content, name="x").shape == (3 * height, 3 * width, 3)
    eia = client.render_eia(cube_file, lenses=(6, 9), pixels=(4, 4), background=(255, 255, 255), format="tiff")
    assert (decode(eia.content, name="x").shape, eia.format) == ((24, 36, 3), "tiff")
    (tmp_path / "p.toml").write_text("panel = {pixels = [60, 40], pitch = 0.1}\nlenses = {pitch = 1, gap = 3}")
    panel = client.make_display_picture(cube_file, display=tmp_path / "p.toml", rotate=(30, 0, 0))
    assert (decode(panel.content, name="x").shape, panel.format) == ((40, 60, 3), "png")
    quilt = client.make_display_picture(eia_file, lenses=(6, 9), quilt="4x4", aspect=0.75)
    assert quilt.name == f"{quilt.id}_qs4x4a0.75.png"
    planes = client.refocus(eia_file, lenses=(6, 9), stack=(-1, 1, 3), format="npy")
    assert np.load(io.BytesIO(planes.content)).shape == (3, 6, 9, 3)
    disparity = client.disparity(eia_file, lenses=(6, 9), view=(0, 1))
    assert (disparity.content[:2], disparity.format) == (b"Pf", "pfm")
    with pytest.raises(InvalidOption, match="format: mp4 can't hold one plane"):
        client.refocus(eia_file, lenses=(6, 9), disparity=0, format="mp4")
    job = client.submit(eia_file, "upscale", model="nearest")
    assert (job.result().format, job.path) == ("png", f"/v1/upscales/{job.id}")


def test_an_inspection(client, eia_file, cube_file):
    assert client.inspect(cube_file)["kind"] == "mesh"
    found = client.inspect(eia_file, lenses=(6, 9))
    assert (found["light_field"]["rows"], found["light_field"]["height"]) == (4, 6)


def test_a_job_by_its_id(client, server, eia_file):
    id_ = client.submit(eia_file, "upscale", model="bicubic").id
    with Client(server) as other:
        job = other.job(id_, "upscale")
        assert (job.result().id, job.status()["state"]) == (id_, "done")
        with pytest.raises(NotFound):
            other.job(id_).status()  # it is no reconstruction
        with pytest.raises(InvalidOption, match=r"^id: '\.\./models' is not a job's id; give the 32 digits"):
            other.job("../models")


def test_tuples_and_folders(client, eia_file, tmp_path):
    by_text = client.reconstruct(eia_file, lenses="6x9", views="1,2;0,3", model="none", format="npz")
    by_values = client.reconstruct(eia_file, lenses=(6, 9), views=[(1, 2), (0, 3)], model="none", format="npz")
    assert by_values.id == by_text.id
    views = tmp_path / "views"
    (views / ".hidden").mkdir(parents=True)
    for v in range(4):
        for u in range(4):
            (views / f"view_{v:02d}_{u:02d}.png").write_bytes(encode_png(EIA[v::4, u::4].copy()))
    made = [client.reconstruct(views, views=(1, 2), model="none") for _ in range(2)]
    assert np.array_equal(decode(made[0].content, name="x"), EIA[1::4, 2::4])
    assert made[0].id == made[1].id  # a folder is packed to the same bytes


def test_the_content_of_a_result_is_not_printed():
    shown = repr(Result("a", b"bytes", "png", {}, "a.png"))
    assert shown == "Result(id='a', format='png', timings_ms={}, name='a.png', notes=())"


def test_the_asynchronous_client(server, eia_file, cube_file):
    async def run():
        async with AsyncClient(server) as client:
            job = await client.submit(eia_file, views="all", lenses=(6, 9), model="none", format="npz")
            kinds = [event.kind async for event in job.events()]
            results = await asyncio.gather(
                job.result(),
                client.reconstruct(eia_file, views=(1, 2), **FIELDS),
                client.upscale(eia_file, model="bicubic"),
                client.render_eia(cube_file, lenses=(6, 9), pixels=(4, 4)),
            )
            with pytest.raises(InvalidOption, match="5x9"):
                await client.reconstruct(eia_file, lenses=(5, 9))
            models = await client.models()
            assert (await client.inspect(cube_file))["kind"] == "mesh"
            assert (await client.job(job.id).status())["state"] == "done"
            return kinds, results, (await job.status())["state"], len(models), await job.cancel()

    kinds, (views, view, large, eia), state, models, last = asyncio.run(run())
    assert (kinds[0], kinds[-1], state, last["state"]) == ("queued", "done", "done", "done")
    assert np.load(io.BytesIO(views.content))["views"].shape == (16, 6, 9, 3)
    assert np.array_equal(decode(view.content, name="x"), EIA[1::4, 2::4])
    assert decode(large.content, name="x").shape == (2 * EIA.shape[0], 2 * EIA.shape[1], 3)
    assert decode(eia.content, name="x").shape == (24, 36, 3)
    assert models > 5


def test_a_file_is_sent_once(client, eia_file, cube_file, tmp_path):
    sent = []
    client.event_hooks["request"].append(lambda request: sent.append(request.url.path))
    kept = client.send_file(eia_file)
    assert (len(kept.id), kept.name, kept.bytes, kept.path) == (
        32,
        "upload.png",
        eia_file.stat().st_size,
        str(eia_file),
    )
    assert client.reconstruct(kept, **FIELDS).id == client.reconstruct(eia_file, **FIELDS).id
    assert client.inspect(kept)["input"]["bytes"] == kept.bytes
    eia = client.render_eia(client.send_file(cube_file.read_bytes()), lenses=(6, 9), pixels=(4, 4))
    large = client.submit(eia, "upscale", model="bicubic")  # of a result, and then of a job
    large.result()
    assert decode(client.upscale(large, model="nearest").content, name="x").shape == (96, 144, 3)
    assert sent.count("/v1/files") == 2
    with pytest.raises(InvalidOption, match="the form has 'scene'; send one part 'file'"):
        client.send_file("scene:vase")


def test_a_file_that_expired_is_sent_again(client, server, eia_file):
    kept = client.send_file(eia_file)
    with eia_file.open("rb") as file:
        content = client.send_file(file)
    assert kept == content
    client.delete(f"/v1/files/{kept.id}")
    with pytest.raises(ResultExpired, match=r"^file_id: no file or result '.*' is kept.*; send the file again$"):
        client.reconstruct(content, **FIELDS)  # its path is not known
    assert client.reconstruct(kept, **FIELDS).id == client.reconstruct(content, **FIELDS).id
    client.delete(f"/v1/files/{kept.id}")
    eia_file.write_bytes(encode_png(EIA[::2].copy()))
    with pytest.raises(ResultExpired):
        client.reconstruct(kept, **FIELDS)  # its bytes have changed

    async def run():
        async with AsyncClient(server) as other:
            kept = await other.send_file(eia_file)
            await other.delete(f"/v1/files/{kept.id}")
            return (await other.upscale(kept, model="bicubic")).id

    assert asyncio.run(run()) == client.upscale(eia_file, model="bicubic").id
