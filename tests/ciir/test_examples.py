"""The commands and the code of the README, the tutorial, docs/python.md and the notebook run as they stand."""

import json
import re
import shlex
from dataclasses import replace

import numpy as np
import pytest

from ciir.renderer.displays.devices import DEVICES
from ciir.renderer.writers.pictures import encode_png
from ciir.service.cli.main import main
from tests.support.paths import ROOT


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read_page(name):
    return (ROOT / name).read_text(encoding="utf-8")


def find_code(page):
    return re.findall(r"```python\n(.*?)```", page, re.DOTALL)


def find_commands(page):
    return [shlex.split(line, comments=True)[1:] for line in re.findall(r"^ciir .*$", page, re.MULTILINE)]


def run_code(blocks, name):
    scope = {}
    for block in blocks:
        exec(compile(block, name, "exec"), scope)  # noqa: S102 - our own page
    return scope


def test_readme(folder, capsys, monkeypatch):
    page = read_page("README.md")
    portrait = replace(DEVICES["portrait"], width=840, height=840)  # in place of 3360x3360 pixels, each with a ray
    monkeypatch.setitem(DEVICES, "portrait", portrait)
    (folder / "demo-out").mkdir()  # as `make demo` leaves it
    (folder / "demo-out" / "view_before.png").write_bytes(encode_png(np.zeros((20, 20, 3), np.uint8)))
    commands = [words for words in find_commands(page) if words[0] not in ("serve", "COMMAND")]
    assert len(commands) > 5
    for words in commands:
        assert main(words) == 0, (words, capsys.readouterr().err)
    run_code(find_code(page), "README.md")
    assert (folder / "views.zip").is_file()


def test_tutorial(folder, capsys):
    page = read_page("docs/tutorial.md")
    for words in find_commands(page):
        assert main(words) == 0, (words, capsys.readouterr().err)
    stated, printed = (
        re.findall(r"(\w+) against truth: PSNR (\S+) dB", text) for text in (page, capsys.readouterr().out)
    )
    run_code(find_code(page), "docs/tutorial.md")
    computed = re.findall(r"(\w+): PSNR (\S+) dB", capsys.readouterr().out)
    assert [name for name, _ in printed] == ["bicubic", "fast", "upscaled"]
    assert [psnr for _, psnr in computed] == [psnr for _, psnr in printed]
    assert [float(psnr) for _, psnr in stated] == pytest.approx([float(psnr) for _, psnr in printed], abs=0.1)


def test_focus_page(folder, capsys):
    commands = find_commands(read_page("docs/focus.md"))
    assert len(commands) > 8
    for words in commands:
        assert main(words) == 0, (words, capsys.readouterr().err)
    assert len(list((folder / "planes").iterdir())) == 10
    estimated, exact = (np.fromfile(folder / f"{name}.pfm", "<f4", offset=14) for name in ("depth", "exact"))
    seen = np.fromfile(folder / "exact_confidence.pfm", "<f4", offset=14) == 1
    assert np.median(np.abs(estimated - exact)[seen]) < 0.07  # BadPix's threshold
    assert f"over {seen.sum()} pixels" in capsys.readouterr().out


def test_python_page(folder, capsys):
    blocks = find_code(read_page("docs/python.md"))
    assert len(blocks) > 5
    run_code(blocks, "docs/python.md")
    printed = capsys.readouterr().out
    for line in re.findall(r"print\(\w+\) +# (.+)", "".join(blocks)):
        assert line.removesuffix("...").rstrip() in printed
    assert {path.name for path in folder.iterdir()} == {
        "eia.png", "epi.png", "views.npy", "views.zip", "cross.zip", "captured.glb",
    }  # fmt: skip


def test_notebook(folder):
    cells = json.loads(read_page("examples/light_field.ipynb"))["cells"]
    scope = run_code(["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"], "light_field.ipynb")
    assert scope["psnr"](scope["large"].view(2, 2)) > scope["psnr"](scope["simple"]) + 1
    assert {path.name for path in folder.iterdir()} == {"eia.png", "views.zip"}
