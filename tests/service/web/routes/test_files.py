"""Files that are sent once and used by several requests."""

import io
import time

import numpy as np
import pytest

from ciir.errors import NoRoom
from ciir.renderer.displays.quilt import QuiltLayout
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.pipeline.options import KINDS
from ciir.service.web import multipart
from ciir.service.web.routes.results import find_root
from ciir.service.web.routes.upload import make_name
from tests.support.inputs import CUBE, make_picture
from tests.support.jobs import set_clock
from tests.support.web import POST, check_problem, post_file, run_app

FILES = "/v1/files"
EIA_FIELDS = {"lenses": "6x9", "model": "none"}
QUILT = f"vase{QuiltLayout(2, 2, 1.5).suffix}.png"


def keep(client, data, name="eia.png", headers=None):
    return client.post(FILES, files={"file": (name, data)}, headers=headers)


def keep_id(client, data, name="eia.png"):
    return keep(client, data, name).json()["id"]


def post_kept(client, id_, kind="reconstruction", **fields):
    """Posts a job whose input is a kept file or the result of a job."""
    return client.post(find_root(kind), files={"file_id": (None, id_)}, data=fields)


def test_a_file_is_sent_read_and_removed(own, eia):
    sent = keep(own, eia)
    assert sent.status_code == 201
    found = sent.json()
    assert found == {"id": found["id"], "name": "upload.png", "bytes": len(eia)}
    place = sent.headers["location"]
    assert place == f"{FILES}/{found['id']}"
    again = keep(own, eia, "Another name.PNG")
    assert (again.status_code, again.json(), again.headers["location"]) == (200, found, place)
    assert own.get(place).json() == found
    assert (own.head(place).status_code, own.head(place).content) == (200, b"")
    assert own.delete(place).json() == found
    for response in (own.get(place), own.delete(place)):
        check_problem(response, 404, "there is no file", "send it again")
    assert own.head(place).status_code == 404
    assert keep(own, eia).status_code == 201
    assert own.pool.runs == 0


@pytest.mark.parametrize("id_", ["0" * 32, "x", "0" * 33, "%2e%2e", "A" * 32])
def test_an_unknown_file(client, id_):
    check_problem(client.get(f"{FILES}/{id_}"), 404, "send it again")
    check_problem(client.delete(f"{FILES}/{id_}"), 404, "send it again")


def test_a_file_is_no_job_and_a_job_is_no_file(own, eia):
    id_ = keep_id(own, eia)
    for kind in KINDS:
        check_problem(own.get(f"{find_root(kind)}/{id_}"), 404)
        check_problem(own.get(f"{find_root(kind)}/{id_}/result"), 404)
        check_problem(own.delete(f"{find_root(kind)}/{id_}"), 404)
    job = post_kept(own, id_, **EIA_FIELDS).headers["x-reconstruction-id"]
    check_problem(own.get(f"{FILES}/{job}"), 404)
    check_problem(own.delete(f"{FILES}/{job}"), 404)
    assert own.get(f"{POST}/{job}").status_code == 200


@pytest.mark.parametrize(
    ("kind", "name", "fields"),
    [
        ("reconstruction", "eia.png", EIA_FIELDS),
        ("reconstruction", "cube.off", {"lenses": "8x6", "pixels": "3x3", "model": "none"}),
        ("reconstruction", QUILT, {"model": "none"}),
        ("upscale", QUILT, {"model": "bicubic"}),
        ("elemental", "cube.off", {"lenses": "8x6", "pixels": "3x3"}),
        ("display", "eia.png", {"lenses": "6x9", "quilt": "2x2"}),
        ("plane", "eia.png", {"lenses": "6x9", "disparity": "1"}),
        ("disparity", "eia.png", {"lenses": "6x9", "limits": "-2:2"}),
        ("inspection", "eia.png", {}),
    ],
)
def test_the_same_job_as_with_the_bytes(own, eia, kind, name, fields):
    data = CUBE if name.endswith(".off") else eia
    kept = post_kept(own, keep_id(own, data, name), kind, **fields)
    assert kept.status_code == 200, kept.text
    sent = own.post(find_root(kind), files={"file": (name, data)}, data=fields)
    assert own.pool.runs == 1
    assert (sent.headers["etag"], sent.content) == (kept.headers["etag"], kept.content)
    status = own.get(kept.headers["content-location"].removesuffix("/result")).json()
    assert status["options"] == fields


@pytest.mark.parametrize(
    "name",
    [
        "a.glb",
        "a",
        "a.tar.gz",
        "x_eslf.png",
        "x_qs8x6a0.75.png",
        "x_qs8x6_eslf.png",
        "x_qs8x6a0.123456789.mp4",
        "x_qs8x6.glb",
    ],
)
@pytest.mark.parametrize("takes_light_fields", [True, False])
def test_a_kept_name_stands_for_the_given_one(name, takes_light_fields):
    kept = make_name(name, takes_light_fields=True)
    direct = make_name(name, takes_light_fields=takes_light_fields)
    assert make_name(kept, takes_light_fields=takes_light_fields) == direct


def test_the_result_of_a_job_is_the_input_of_another(own):
    eia = post_file_of_kind(own, "elemental", "cube.off", CUBE, lenses="6x9", pixels="4x4")
    id_ = eia.headers["x-elemental-id"]
    large = post_kept(own, id_, "upscale", model="bicubic")
    height, width = decode(eia.content, name="x").shape[:2]
    assert decode(large.content, name="x").shape[:2] == (2 * height, 2 * width)
    plane = post_kept(own, id_, "plane", lenses="6x9", disparity="1")
    assert plane.status_code == 200
    runs = own.pool.runs
    name = eia.headers["content-disposition"].partition('"')[2].rstrip('"')
    sent = post_file_of_kind(own, "plane", name, eia.content, lenses="6x9", disparity="1")
    assert (sent.headers["etag"], own.pool.runs) == (plane.headers["etag"], runs)


def post_file_of_kind(client, kind, name, data, **fields):
    response = client.post(find_root(kind), files={"file": (name, data)}, data=fields)
    assert response.status_code == 200, response.text
    return response


def test_a_quilt_of_the_server_keeps_its_layout(own, eia):
    quilt = post_file_of_kind(own, "display", "eia.png", eia, lenses="6x9", quilt="2x2")
    view = post_kept(own, quilt.headers["x-display-id"], model="none")
    report = own.get(view.headers["content-location"].removesuffix("/result")).json()["report"]
    assert (report["lens_array"]["pixels_v"], report["lens_array"]["pixels_u"]) == (1, 4)  # 2x2 views in a row


def test_an_id_that_is_not_kept(own, eia, monkeypatch):
    remedy = "send the file again"
    for id_ in ("0" * 32, "x", "../../x", "\0", "A" * 32, "0" * 5000):
        response = post_kept(own, id_, **EIA_FIELDS)
        check_problem(response, 410, f"file_id: no file or result {ascii_start(id_)}", remedy)
        assert response.json()["type"] == "urn:ciir:expired"
    failed = post_file(own, data=eia[:60], lenses="6x9").status_code
    assert failed == 422
    (id_,) = own.engine.jobs.queue.jobs.items()
    check_problem(
        post_kept(own, id_, **EIA_FIELDS), 410, f"file_id: the job {id_} has no result: it failed (upload.png"
    )
    id_ = keep_id(own, eia)
    own.engine.jobs.files.remove("results", own.engine.jobs.get(id_).output)
    check_problem(post_kept(own, id_, **EIA_FIELDS), 410, remedy)
    check_problem(own.get(f"{FILES}/{id_}"), 404)
    assert keep(own, eia).status_code == 201
    set_clock(monkeypatch, time.time() + 86_401)
    own.engine.jobs.sweep()
    check_problem(post_kept(own, id_, **EIA_FIELDS), 410, remedy)
    check_problem(own.get(f"{FILES}/{id_}"), 404)
    assert keep_id(own, eia) == id_
    assert post_kept(own, id_, **EIA_FIELDS).status_code == 200


def ascii_start(id_):
    return f"'{id_[:8]}" if id_.isprintable() else "'"


def test_a_job_that_has_not_ended(tmp_path, eia):
    with run_app(tmp_path, workers=0) as own:
        place = post_file(own, data=eia, headers={"Prefer": "respond-async"}, **EIA_FIELDS).headers["location"]
        response = post_kept(own, place.rpartition("/")[2], "upscale")
        check_problem(response, 409, "file_id: the job", "is queued; send this again once it is done")
        assert response.headers["retry-after"] == "1"


def test_one_input_is_given(client, eia):
    id_ = keep_id(client, eia)
    kept, scene, file = ("file_id", (None, id_)), ("scene", (None, "vase")), ("file", ("a.png", eia))
    for parts, cause in (
        ([kept, file], "file_id: given together with file; send one of them"),
        ([kept, scene], "scene: given together with file_id; send one of them"),
        ([file, scene], "scene: given together with file; send one of them"),
        ([kept, file, scene], "scene: given together with file_id and file; send one of them"),
        ([("lenses", (None, "6x9"))], "the part 'file', the id of a kept file as 'file_id', or a shipped scene"),
        ([("file_id", (None, " ")), ("lenses", (None, "6x9"))], "file: missing"),
        ([("file_id", ("a.png", eia))], "file_id: a file; only 'file' may be one, send this as a plain field"),
    ):
        check_problem(client.post(POST, files=parts), 422, cause)
    form = [("file_id", (None, id_)), ("file_id", (None, id_))]
    check_problem(client.post(POST, files=form), 422, "file_id: given twice")


def test_two_clients_send_the_same_file(tmp_path, eia):
    first, second = ({"X-API-Key": key} for key in ("first", "second"))
    with run_app(tmp_path, api_keys="first,second") as own:
        check_problem(keep(own, eia), 401)
        place = keep(own, eia, headers=first).headers["location"]
        assert keep(own, eia, headers=second).status_code == 200
        check_problem(own.get(place), 401)
        check_problem(own.delete(place), 401)
        assert own.delete(place, headers=first).status_code == 200
        assert own.get(place, headers=first).status_code == 200  # the second client keeps it
        assert own.delete(place, headers=first).status_code == 200  # and a client that has removed it removes nothing
        assert own.get(place, headers=second).status_code == 200
        assert own.delete(place, headers=second).status_code == 200
        check_problem(own.get(place, headers=second), 404)


def test_a_result_over_the_limit_on_files(tmp_path):
    with run_app(tmp_path, max_body_bytes=4000) as own:
        picture = encode_png(make_picture(20, 20))
        large = post_file_of_kind(own, "upscale", "a.png", picture, model="bicubic")
        assert len(large.content) > 4000
        response = post_kept(own, large.headers["x-upscale-id"], "upscale", model="bicubic")
        check_problem(response, 413, "file_id: a result of", "over the limit of 4,000; make a smaller one")
        check_problem(keep(own, large.content), 413, "over the limit of 4,000 bytes; send a smaller file")


def test_bad_forms(client, eia):
    nothing_else = "send one part 'file' with a file name, and nothing else"
    for parts, cause in (
        ([("files", ("a.png", eia))], "the form has 'files'"),
        ([("file", (None, "text"))], "the form has 'file'"),
        ([("file", ("a.png", eia)), ("lenses", (None, "6x9"))], "the form has 'file', 'lenses'"),
        ([("file", ("a.png", eia))] * 2, "the form has 'file', 'file'"),
        ([("scene", (None, "vase"))], "the form has 'scene'"),
    ):
        check_problem(client.post(FILES, files=parts), 422, cause, nothing_else)
    end = {"content-type": "multipart/form-data; boundary=x"}
    check_problem(client.post(FILES, content="--x--\r\n", headers=end), 422, "the form has nothing", nothing_else)
    check_problem(client.post(FILES, content="--x\r\n", headers=end), 400, "send the whole body")
    check_problem(client.post(FILES, content=eia, headers={"content-type": "image/png"}), 415, "multipart/form-data")
    check_problem(client.post(FILES), 415, "the body has no type")
    squeezed = client.post(FILES, files={"file": ("a.png", eia)}, headers={"content-encoding": "gzip"})
    check_problem(squeezed, 415, "compressed")
    check_problem(client.post(f"{FILES}?name=a", files={"file": ("a.png", eia)}), 422, "'name': in the URL's query")
    check_problem(keep(client, eia, "a_qs0x0a1.png"), 422, "columns")
    check_problem(client.put(FILES), 405)


def test_a_server_that_takes_no_files(own, eia, monkeypatch):
    def refuse():
        raise NoRoom("the server's disk is full; try again later")

    id_ = keep_id(own, eia)
    with monkeypatch.context() as patch:
        patch.setattr(own.engine.jobs.disk, "check", refuse)
        check_problem(keep(own, b"other"), 503, "full")
        assert keep(own, eia).json()["id"] == id_
    own.engine.stop_accepting()
    check_problem(keep(own, eia), 503, "stopping")
    assert own.get(f"{FILES}/{id_}").status_code == 200


def test_files_that_there_is_no_room_to_keep(tmp_path):
    with run_app(tmp_path, keep_bytes=8) as client:
        check_problem(keep(client, b"over eight"), 413, "10 bytes are over the limit of 8", "with each request")
        keep_id(client, b"four")
        refused = keep(client, b"other")
        check_problem(refused, 503, "try again in a minute")
        assert refused.headers["retry-after"] == "60"


def test_a_disk_that_fills_during_the_upload_is_a_minute_too(own, monkeypatch):
    async def refuse(request):
        raise NoRoom("the server's disk is full; try again later")

    monkeypatch.setattr(multipart, "read_form", refuse)
    refused = keep(own, b"other")
    check_problem(refused, 503, "full")
    assert refused.headers["retry-after"] == "60"


def test_a_file_is_never_read_whole(own, monkeypatch):
    data = np.random.default_rng(0).bytes(5 * 2**20)
    asked = []

    class Spool(io.BytesIO):
        def read(self, size=-1):
            asked.append(size)
            return super().read(size)

    monkeypatch.setattr("starlette.formparsers.SpooledTemporaryFile", lambda **_: Spool())
    assert keep(own, data).json()["bytes"] == len(data)
    assert asked
    assert all(0 < size <= 2**20 for size in asked)
