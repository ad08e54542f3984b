"""A batch whose inputs and outputs are in S3."""

import io
import json
import zipfile

import pytest
import s3fs

from ciir.renderer.light_field import LightField
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.pictures import encode_png
from ciir.service.batch import parts
from ciir.service.cli.main import main
from tests.containers.object_store import run_store
from tests.support.inputs import CUBE
from tests.support.light_fields import make_views

pytestmark = pytest.mark.usefixtures("workers_in_this_process")
ARRAY = LightField(make_views((3, 3), side=12, channels=3)).eia()
OPTIONS = ("--workers", "1", "--lenses", "12x12", "--pixels", "3x3", "--model", "none")


@pytest.fixture
def objects(monkeypatch):
    """The store's objects, by bucket and key: an array and a mesh."""
    with run_store() as (environment, objects):
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        s3fs.S3FileSystem.clear_instance_cache()
        objects |= {"captures/day/array.png": encode_png(ARRAY), "captures/cube.off": CUBE}
        yield objects
    s3fs.S3FileSystem.clear_instance_cache()


def test_inputs_and_outputs_are_urls(objects, capsys):
    assert main(["batch", "s3://captures", "-o", "s3://results/run", "--name", "{path}.png", *OPTIONS]) == 0
    assert decode(objects["results/run/day/array.png"], name="array").tolist() == ARRAY[1::3, 1::3].tolist()
    assert decode(objects["results/run/cube.png"], name="cube").shape == (12, 12, 3)
    assert json.loads(objects["results/run/summary.json"])["done"] == 2
    capsys.readouterr()
    objects["captures/cube.off"] = CUBE.replace(b"1", b"2")
    assert main(["batch", "s3://captures/*", "-o", "s3://results/run", "--name", "{path}.png", *OPTIONS]) == 0
    rows = json.loads(objects["results/run/summary.json"])["results"]
    assert {row["output"]: row["status"] for row in rows} == {"day/array.png": "kept", "cube.png": "done"}


def test_parts_of_a_large_light_field_are_joined_and_removed(objects, monkeypatch):
    monkeypatch.setattr(parts, "PART_PIXELS", 4 * 24 * 24)
    source = "s3://captures/day/array.png"
    assert main(["batch", source, "-o", "s3://results/cut", "--name", "{stem}.zip", "--views", "all", *OPTIONS]) == 0
    with zipfile.ZipFile(io.BytesIO(objects["results/cut/array.zip"])) as file:
        for v, u in ((0, 0), (2, 1)):
            assert decode(file.read(f"view_{v:02d}_{u:02d}.png"), name="view").tolist() == ARRAY[v::3, u::3].tolist()
    assert not [key for key in objects if "/parts/" in key]


@pytest.mark.parametrize("place", ["input", "outputs"])
def test_a_store_that_is_not_reached(objects, monkeypatch, tmp_path, capsys, place):
    (tmp_path / "cube.off").write_bytes(CUBE)
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    s3fs.S3FileSystem.clear_instance_cache()
    places = (
        ("s3://captures", str(tmp_path / "out")) if place == "input" else (str(tmp_path / "cube.off"), "s3://results")
    )
    assert main(["batch", places[0], "-o", places[1], *OPTIONS]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    url = next(each for each in places if "://" in each)
    assert line.startswith(f"ciir: {url}: can't be reached (Unable to locate credentials); check the address")


def test_outputs_among_the_inputs_are_refused(objects, capsys):
    objects["captures/out/first.png"] = encode_png(ARRAY)
    assert main(["batch", "s3://captures", "-o", "s3://captures/out", *OPTIONS]) != 0
    assert "s3://captures/out: this lies in the input s3://captures" in capsys.readouterr().err
    for out in ("s3://captures/out", "s3a://captures/out/"):  # one place
        assert main(["batch", "s3://captures/*/*.png", "-o", out, *OPTIONS]) != 0
        assert f"{out}: the input s3://captures/out/first.png is there" in capsys.readouterr().err


def test_what_is_not_there_is_named(objects, capsys):
    assert main(["batch", "s3://captures/night.png", "-o", "s3://results/run", *OPTIONS]) != 0
    assert "s3://captures/night.png: there is no such file or folder" in capsys.readouterr().err
