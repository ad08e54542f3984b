import io
import json
import re
import zipfile

import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.readers.pictures import decode
from ciir.renderer.writers.depth import maps
from ciir.renderer.writers.file_writer import FileWriter, make_writer
from ciir.renderer.writers.folder import FolderWriter
from ciir.renderer.writers.formats import FORMATS
from ciir.renderer.writers.options import WriterOptions
from ciir.renderer.writers.pictures import FORMATS as PICTURES
from ciir.renderer.writers.writer import Contents, Writer, file_name
from tests.support.inputs import EIA, make_picture
from tests.support.paths import ROOT

VIEWS = [(0, 1), (14, 0), (100, 7)]


def describe(views, picture):
    return Contents(tuple(views), (101, 15), *picture.shape, picture.dtype)


def fill(writer, dtype=np.uint8):
    pictures = [make_picture(5, 7, 3, dtype, seed) for seed in range(len(VIEWS))]
    writer.begin(describe(VIEWS, pictures[0]))
    names = [writer.write(view, picture) for view, picture in zip(VIEWS, pictures, strict=True)]
    writer.finish({"answer": 42, "notes": []})
    assert names == [file_name(view) for view in VIEWS]
    return names, pictures


def test_every_format_is_in_the_docs():
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    views, _, disparities = page.partition("### Disparity maps")
    rows = {
        name: row for names, row in re.findall(r"^\| ([\w, -]+) (\|.*)$", views, re.M) for name in names.split(", ")
    }
    for name, entry in FORMATS.items():
        module = f"pictures/{name}" if name in PICTURES else entry.writer.partition(":")[0].replace(".", "/")
        assert rows[name].endswith(f"| `renderer/writers/{module}.py` |")
    for name, kind in maps.FORMATS.items():
        assert f"| {name} | {', '.join(f'`{suffix}`' for suffix in kind.suffixes)} |" in disparities


@pytest.mark.parametrize("name", FORMATS)
def test_every_writer_is_found(name):
    assert isinstance(make_writer(FORMATS[name], io.BytesIO(), WriterOptions()), Writer)


def test_names():
    assert [file_name(view) for view in VIEWS] == ["view_00_01.png", "view_14_00.png", "view_100_07.png"]


def test_folder(tmp_path):
    with FolderWriter(tmp_path / "out") as writer:
        names, pictures = fill(writer)
    for name, picture in zip(names, pictures, strict=True):
        assert np.array_equal(decode((tmp_path / "out" / name).read_bytes(), name=name), picture)
    assert json.loads((tmp_path / "out" / "report.json").read_text()) == {"answer": 42, "notes": []}
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_is_not_finished_leaves_nothing(tmp_path):
    with FolderWriter(tmp_path / "out") as writer:
        writer.begin(describe([(0, 0)], EIA))
        writer.write((0, 0), EIA)
        assert len(list(tmp_path.iterdir())) == 1
    assert list(tmp_path.iterdir()) == []


def test_zip():
    file = io.BytesIO()
    names, pictures = fill(FileWriter(file, "zip"))
    with zipfile.ZipFile(file) as archive:
        assert archive.namelist() == [*names, "report.json"]
        for name, picture in zip(names, pictures, strict=True):
            assert np.array_equal(decode(archive.read(name), name=name), picture)
        assert json.loads(archive.read("report.json")) == {"answer": 42, "notes": []}


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_npz(dtype):
    file = io.BytesIO()
    _, pictures = fill(FileWriter(file, "npz"), dtype)
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        assert arrays["views"].dtype == dtype
        assert np.array_equal(arrays["views"], np.stack(pictures))
        assert arrays["positions"].tolist() == [list(view) for view in VIEWS]
        assert json.loads(str(arrays["report"])) == {"answer": 42, "notes": []}


def test_png_holds_one_view():
    file = io.BytesIO()
    writer = FileWriter(file, "png")
    with pytest.raises(InvalidOption, match=r"png.*3"):
        writer.begin(describe(VIEWS, EIA))
    writer.begin(describe([(0, 0)], EIA))
    writer.write((0, 0), EIA)
    writer.finish({})
    assert np.array_equal(decode(file.getvalue(), name="x"), EIA)


@pytest.mark.parametrize(("count", "chosen"), [(1, "png"), (2, "zip")])
def test_format_follows_the_count(count, chosen):
    writer = FileWriter(io.BytesIO(), None)
    writer.begin(describe(VIEWS[:count], EIA))
    assert writer.format.name == chosen


def test_unknown_format():
    with pytest.raises(InvalidOption, match=r"'bmp'.*give png, .*zip, npz"):
        FileWriter(io.BytesIO(), "bmp")
