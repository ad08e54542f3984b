import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from renderer.bundle import Bundle
from renderer.errors import InvalidOption
from service import answers
from service.answers import NotedFiles, answer
from service.request import Options
from service.store import Store

OPTIONS = Options(lenses=(6, 9), views="cross", model="bicubic")


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store", 10_000_000)


@pytest.fixture
def runs(monkeypatch):
    """A list with an entry for each reconstruction that is really made."""
    made = []
    whole = answers.pipeline.reconstruct
    monkeypatch.setattr(
        answers.pipeline, "reconstruct", lambda *given, **options: made.append(given) or whole(*given, **options)
    )
    return made


def asked(data, options=OPTIONS, form="zip", *, name="a.png", **given):
    made = answer(Bundle.from_upload(name, data), options, form, **given)
    with made.file:
        data = made.file.read()
    assert len(data) == made.size
    assert not made.trouble
    return made, data


@pytest.mark.parametrize("form", ["zip", "npz"])
def test_out_of_the_store_only_the_times_differ(samples, store, runs, form):
    data = samples.encode_png(samples.EIA)
    first, one = asked(data, form=form, store=store)
    counted = []
    again, other = asked(data, form=form, store=store, progress=counted.append)
    assert len(runs) == 1
    assert counted == [5]
    assert set(again.report["timings_ms"]) == {"stored", "total"}
    assert "stored" not in first.report["timings_ms"]
    assert {**again.report, "timings_ms": 0} == json.loads(json.dumps({**first.report, "timings_ms": 0}))
    assert again.format == first.format == form
    with zipfile.ZipFile(io.BytesIO(one)) as a, zipfile.ZipFile(io.BytesIO(other)) as b:
        assert a.namelist() == b.namelist()
        assert b.testzip() is None
        *views, report = a.namelist()
        assert all(a.read(view) == b.read(view) for view in views)
        start = a.getinfo(report).header_offset
        assert one[:start] == other[:start]  # to the byte
        if form == "zip":
            assert json.loads(b.read(report)) == again.report
    if form == "npz":
        with np.load(io.BytesIO(other), allow_pickle=False) as arrays:
            assert json.loads(str(arrays["report"])) == again.report


def test_a_png_comes_back_as_it_was(samples, store, runs):
    data, options = samples.encode_png(samples.EIA), replace(OPTIONS, views="center")
    first, again = (asked(data, options, None, store=store) for _ in range(2))
    assert first[1] == again[1]
    assert (again[0].format, len(runs)) == ("png", 1)


def test_what_differs_is_made(samples, store, runs, monkeypatch):
    data = samples.encode_png(samples.EIA)
    asked(data, store=store)
    asked(samples.encode_png(samples.EIA[::-1]), store=store)
    asked(data, replace(OPTIONS, views="all"), store=store)
    asked(data, form="npz", store=store)
    asked(data, store=store, max_pixels=100_000)
    asked(data, store=store, name="b.png")
    monkeypatch.setattr(answers, "installation", lambda: "another version")
    asked(data, store=store)
    assert len(runs) == 7
    asked(data)  # without a store
    assert len(runs) == 8


def test_another_processor_makes_its_own(samples, store, runs, monkeypatch):
    """What `auto` takes depends on it."""
    data = samples.encode_png(samples.EIA)
    asked(data, store=store)
    monkeypatch.setattr(answers.processor, "against_int8", lambda: "this processor has no VNNI")
    asked(data, store=store)
    assert len(runs) == 2


def test_a_damaged_result_is_made_again(samples, store, runs, tmp_path):
    data = samples.encode_png(samples.EIA)
    asked(data, store=store)
    (path,) = (tmp_path / "store").iterdir()
    path.write_bytes(path.read_bytes()[:-5])
    asked(data, store=store)
    assert len(runs) == 2
    assert asked(data, store=store)[0].report["timings_ms"].keys() == {"stored", "total"}


def test_files_beside_the_input_count(samples, store, runs, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    mesh, material = folder / "a.obj", folder / "a.mtl"
    mesh.write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    material.write_text("newmtl m\nKd 1 0 0\n")
    options = Options(lenses=(6, 9), pixels=(1, 1), model="none", backend="raytrace")

    def made():
        answer(Bundle.from_path(mesh), options, None, store=store).file.close()
        return len(runs)

    assert [made(), made()] == [1, 1]
    (folder / "other.txt").write_text("of no matter")
    assert made() == 1
    material.write_text("newmtl m\nKd 0 1 0\n")
    assert made() == 2
    assert made() == 2
    material.unlink()
    assert made() == 3
    assert made() == 3
    material.write_text("newmtl m\nKd 0 1 0\n")
    assert made() == 4


def test_folders_and_scenes(samples, store, runs, tmp_path):
    folder = tmp_path / "views"
    folder.mkdir()
    for v in range(2):
        for u in range(2):
            (folder / f"view_{v:02d}_{u:02d}.png").write_bytes(
                samples.encode_png(samples.picture(6, 9, seed=2 * v + u))
            )
    options = Options(views="all", model="none")
    for count in (1, 1):
        answer(Bundle.from_path(folder), options, "zip", store=store).file.close()
        assert len(runs) == count
    (folder / "view_01_01.png").write_bytes(samples.encode_png(samples.picture(6, 9, seed=9)))
    answer(Bundle.from_path(folder), options, "zip", store=store).file.close()
    assert len(runs) == 2
    scene = Options(lenses=(4, 4), pixels=(1, 1), model="none", backend="raytrace")
    for name in ("vase", "vase", "globe"):
        answer(name, scene, "png", store=store).file.close()
    assert len(runs) == 4


@pytest.fixture
def bodies(monkeypatch):
    """What the store gave out."""
    given = []
    whole = Store.get

    def get(self, key):
        found = whole(self, key)
        if found is not None:
            given.append(found.body)
        return found

    monkeypatch.setattr(Store, "get", get)
    return given


def test_who_leaves_leaves_nothing_open(samples, store, runs, bodies):
    data = samples.encode_png(samples.EIA)
    asked(data, store=store)

    def gone(_):
        raise OSError("the client has left")

    with pytest.raises(OSError, match="has left"):
        asked(data, store=store, progress=gone)
    assert [body.closed for body in bodies] == [True]
    assert len(runs) == 1


def test_what_cannot_be_compared_is_made_and_left_closed(samples, store, runs, bodies, monkeypatch):
    data = samples.encode_png(samples.EIA)
    asked(data, store=store)

    def unreadable(self, seen):
        raise OSError("the disk is gone")

    monkeypatch.setattr(NotedFiles, "agree", unreadable)
    made = answer(Bundle.from_upload("a.png", data), OPTIONS, "zip", store=store)
    made.file.close()
    assert "the disk is gone" in made.trouble
    assert [body.closed for body in bodies] == [True]
    assert len(runs) == 2


@pytest.mark.parametrize("form", ["zip", "npz"])
def test_only_a_report_is_replaced(form):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("report.json" if form == "zip" else "report.npy", b"{}")
        archive.writestr("view_00_00.png", b"a view")
    before = file.getvalue()
    with pytest.raises(ValueError, match=r"view_00_00\.png comes last"):
        answers._replace_report(file, form, {"notes": []})
    assert file.getvalue() == before


def test_a_store_that_fails_is_told_of_and_the_result_is_made(samples, tmp_path):
    (tmp_path / "file").write_bytes(b"no folder")
    bundle = Bundle.from_upload("a.png", samples.encode_png(samples.EIA))
    made = answer(bundle, OPTIONS, "zip", store=Store(tmp_path / "file", 10_000_000))
    with made.file, zipfile.ZipFile(made.file) as archive:
        assert "report.json" in archive.namelist()
    assert str(tmp_path / "file") in made.trouble
    assert "\n" not in made.trouble


def test_faults_are_not_stored(samples, store, tmp_path):
    for _ in range(2):
        with pytest.raises(InvalidOption, match="png holds one view"):
            asked(samples.encode_png(samples.EIA), form="png", store=store)
    assert not (tmp_path / "store").exists()


def test_all_that_was_asked_of_files_is_noted():
    files = {"a": b"1", "b": b"2"}
    noted = NotedFiles(files)
    assert noted["a"] == b"1"
    assert "b" in noted
    assert "c" not in noted
    with pytest.raises(KeyError):
        noted["d"]
    assert noted.agree(noted.seen)
    for now in ({"a": b"2", "b": b"2"}, {"a": b"1"}, files | {"c": b""}, files | {"d": b""}):
        assert not NotedFiles(now).agree(noted.seen)
    assert NotedFiles({"a": b"1", "b": b"other", "e": b""}).agree(noted.seen)  # nobody asked for what b holds
    assert (list(noted), len(noted)) == (["a", "b"], 2)
    assert not NotedFiles(files | {"e": b""}).agree(noted.seen)


def test_an_installation_has_one_name():
    assert answers.installation() == answers.installation()
    assert len(answers.installation()) == 64
