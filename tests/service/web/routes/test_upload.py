"""What a form may hold, and what of it is refused."""

import io

import numpy as np
import pytest
from starlette.datastructures import UploadFile

import ciir
from ciir.renderer.displays.quilt import QuiltLayout, join_views
from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode
from ciir.service.pipeline.options import KINDS
from ciir.service.web.routes import results
from ciir.service.web.routes.upload import parse_form
from tests.support.inputs import BAD_INPUTS, contains_all
from tests.support.light_fields import make_views
from tests.support.web import POST, check_problem, post_file


def test_only_the_suffix_of_a_file_name_is_used(client):
    detail = check_problem(post_file(client, "../../etc/pass\nwd.TXT", b"hello"), 415)
    assert "upload.txt" in detail
    assert "pass" not in detail


@pytest.mark.parametrize(
    ("kind", "given", "kept"),
    [
        ("reconstruction", "C:\\my\\a_QS08x6a0.750.PNG", "upload_qs8x6a0.75.png"),
        ("display", "a_qs8x6a0.75 (1).jpg", "upload_qs8x6a0.75.jpg"),
        ("inspection", "a_qs8x6.webp", "upload_qs8x6.webp"),
        ("inspection", "a_qs8x6a0.75.MP4", "upload_qs8x6a0.75.mp4"),
        ("inspection", "../a_qs8x6a0.75/b.png", "upload.png"),
        ("reconstruction", "a_qs8x6a0.75.glb", "upload.glb"),
        ("upscale", "a_qs99x6a0.75.png", "upload.png"),
        ("disparity", "IMG_1_ESLF.png", "upload_eslf.png"),
        ("disparity", "IMG_1_eslf.jpg", "upload.jpg"),
    ],
)
def test_what_makes_a_picture_a_quilt_or_eslf_is_kept_of_a_name(kind, given, kept):
    sent = UploadFile(io.BytesIO(b"x"), filename=given)
    assert parse_form([("file", sent)], KINDS[kind]).request.name == kept


def test_a_quilt_is_read_by_its_name(client):
    field = LightField(make_views((1, 6), side=24), depth_sense="cameras")
    quilt = encode(join_views(field.views[0], QuiltLayout(3, 2, 1.0)), ".png")

    def inspect(name):
        return client.post("/v1/inspections", files={"file": (name, quilt)})

    assert inspect("a_qs3x2a1.png").json()["light_field"]["cols"] == 6
    # The same bytes in another layout are another job.
    assert inspect("a_qs2x3a1.png").json()["light_field"]["height"] == 16
    assert inspect("a.png").json()["kind"] != "views"
    check_problem(inspect("a_qs99x2a1.png"), 422, "99x2 is out of range")


def test_eslf_is_read_by_its_name(client):
    eia = LightField(make_views((14, 14), side=16, disparities=(0, 0))).eia()

    def read(name):
        return client.post("/v1/inspections", files={"file": (name, encode(eia, ".png"))}).json()

    assert read("a_eslf.png")["light_field"]["depth_sense"] == "cameras"
    assert read("a.png")["kind"] != "views"


@pytest.mark.parametrize(
    ("kind", "taken", "others"), [("upscale", ".webp", (".glb", ".mp4")), ("elemental", ".glb", (".png", ".mp4"))]
)
def test_a_type_that_is_not_read_names_those_that_the_kind_takes(client, kind, taken, others):
    detail = check_problem(client.post(results.find_root(kind), files={"file": ("a.md", b"# hello")}), 415, taken)
    assert not any(other in detail for other in others)


def test_empty_fields_are_ignored(client, eia):
    assert post_file(client, data=eia, lenses="6x9", scale="", pitch=" ", format="").status_code == 200


@pytest.mark.parametrize("bad_input", BAD_INPUTS.values(), ids=BAD_INPUTS)
def test_bad_input(client, bad_input):
    name, data, texts, status, parts = bad_input
    for _ in range(2):
        runs = client.pool.runs
        detail = check_problem(post_file(client, name, data, **texts), status)
        assert contains_all(detail, parts), detail
    assert client.pool.runs == runs  # an input error is final


@pytest.mark.parametrize(
    ("kind", "texts", "said"),
    [
        ("plane", {}, "no plane is asked for"),
        ("plane", {"disparity": "1", "stack": "0:1:3"}, "these ask for different pictures"),
        ("plane", {"depth": "5", "sensor": "2"}, "sensor: this needs camera_pitch"),
        ("disparity", {"limits": "2:-2"}, "limits: 2:-2 is not a range"),
        ("disparity", {"points": "yes"}, "points: only a PLY holds points"),
        ("disparity", {"camera_pitch": "2", "format": "glb"}, "camera_pitch: depths need focal_length and sensor too"),
        ("reconstruction", {"lens_rotation": "1"}, "lens_rotation: this needs lens_pitch"),
        ("reconstruction", {"fps": "5"}, "fps: the default format, png or zip, has no use for it; leave it out, or"),
        ("reconstruction", {"epi": "y=1", "format": "npz"}, "epi: format npz has no use for it; leave it out, or"),
        ("display", {"calibration": "{}", "format": "quilt"}, "calibration: format quilt has no use for it"),
        ("display", {"device": "go", "format": "panel"}, "device: format panel has no use for it"),
        ("display", {"format": "panel"}, "display: a panel's picture needs it"),
        ("display", {"calibration": "[]"}, "calibration: no calibration; give the JSON"),
        ("plane", {"disparity": "1", "fps": "5"}, "fps: format png has no use for it"),
        ("plane", {"stack": "0:1:3", "format": "png"}, "format: png can't hold a stack of planes"),
    ],
)
def test_options_that_dont_go_together_are_refused_before_the_queue(client, eia, kind, texts, said):
    headers = {"prefer": "respond-async"}
    sent = client.post(results.find_root(kind), files={"file": ("a.png", eia)}, data=texts, headers=headers)
    check_problem(sent, 422, said)


def test_a_shipped_scene_takes_the_place_of_the_file(own):
    fields = {"lenses": "8x6", "pixels": "3x3", "model": "none"}
    shown = {}
    for scene in ("vase", "globe"):
        done = own.post(POST, files={"scene": (None, scene)}, data=fields)
        shown[scene] = decode(done.content, name="x")
        status = own.get(f"{POST}/{done.headers['x-reconstruction-id']}").json()
        assert (status["input"], status["report"]["input"]["kind"]) == (f"scene:{scene}", "scene")
    for scene, picture in shown.items():
        expected = ciir.render(f"scene:{scene}", lenses=(8, 6), pixels=(3, 3)).view(1, 1)
        assert np.array_equal(picture, expected)
    again = own.post(POST, data={"scene": "vase", **fields})  # application/x-www-form-urlencoded
    assert again.headers["server-timing"].startswith("stored")
    assert own.pool.runs == 2


@pytest.mark.parametrize("name", ["file", "calibration"])
def test_file_inputs_that_a_browser_leaves_empty_count_as_not_sent(client, name):
    empty = f'--x\r\nContent-Disposition: form-data; name="{name}"; filename=""\r\n\r\n{{}}\r\n'
    fields = {"scene": "vase", "lenses": "4x4", "pixels": "2x2", "model": "none"}
    rest = [f'--x\r\nContent-Disposition: form-data; name="{key}"\r\n\r\n{text}\r\n' for key, text in fields.items()]
    headers = {"content-type": "multipart/form-data; boundary=x", "prefer": "respond-async"}

    def send(content, *more):
        return client.post(POST, content="".join([empty.format(content), *more, "--x--\r\n"]), headers=headers)

    assert send("", *rest).status_code == 202
    check_problem(send("data", *rest), 422, name)
    check_problem(send(""), 422, "file: missing; send")


@pytest.mark.parametrize("kind", KINDS)
def test_options_in_the_query_are_refused(client, eia, kind):
    sent = client.post(f"{results.find_root(kind)}?model=none&lenses=10x10&model=", files={"file": ("a.png", eia)})
    detail = check_problem(sent, 422, "'lenses', 'model': in the URL's query", "send each as a field of the form")
    assert "/" not in detail


def test_bad_forms(client, eia):
    problem, send = check_problem, post_file
    problem(send(client, data=eia, lens="6x9"), 422, "'lens'", "lenses")
    problem(send(client, data=eia, lenses="6x9", views="all", format="png"), 422, "16", "zip")
    problem(send(client, data=eia, lenses="6x9", format="bmp"), 422, "bmp", "npz")
    problem(
        client.post(POST, files={"files": ("a.png", eia)}),
        422,
        "files: a file",
        "only 'file' may be one, use that name; send several as a zip",
    )
    problem(client.post(POST, files={"lenses": ("a.png", eia)}), 422, "lenses: a file", "send this as a plain field")
    takes_views = "model: field takes the views of a light field, in a reconstruction; for pictures give one of auto"
    problem(client.post("/v1/upscales", files={"file": ("a.png", eia)}, data={"model": "field"}), 422, takes_views)
    problem(client.post(POST, files={"lenses": (None, "6x9")}), 422, "file: missing")
    problem(client.post(POST, files={"scene": (None, "../vase")}), 422, "scene: no '../vase' here", "vase, globe")
    problem(client.post(POST, files={"scene": ("vase.png", eia)}), 422, "scene: a file")
    problem(send(client, data=eia, lenses="6x9", scene="vase"), 422, "scene: given together with file; send one")
    problem(client.post("/v1/upscales", files={"scene": (None, "vase")}), 422, "'scene': no such field")
    problem(client.post(POST, files={"file": (None, "text")}), 422, "plain field")
    problem(client.post(POST, files=[("lenses", (None, "6x9")), ("lenses", (None, "1x1"))]), 422, "twice")
    two = [("file", ("a.obj", eia)), ("file", ("a.mtl", eia))]
    problem(client.post(POST, files=two), 422, "file: given twice; send several files as one zip")
    problem(client.post(POST, data={"lenses": "6x9"}), 422, "file: missing")
    problem(client.post(POST, data={"file": "a.png"}), 422, "plain field")
    urlencoded = {"content-type": "application/x-www-form-urlencoded"}
    problem(client.post(POST, content=eia, headers=urlencoded), 400, "up to 65,536 bytes; send a file, and a")
    problem(client.post(POST, content=eia), 415, "the body has no type;")
    problem(client.post(POST, json={"file": "x"}), 415, "application/json")
    files = {"file": ("a.png", eia)}
    for encoding, status in (("gzip", 415), ("br, gzip", 415), ("identity", 200), ("", 200)):
        headers = {"Content-Encoding": encoding}
        response = client.post(POST, headers=headers, files=files, data={"lenses": "6x9", "model": "none"})
        assert response.status_code == status
        if status == 415:
            problem(response, 415, f"the body is compressed (Content-Encoding: '{encoding}'); send it as it is")
