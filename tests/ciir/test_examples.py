import json
import re

from tests.support.paths import ROOT


def test_the_code_of_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python.md").read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) > 5
    scope = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), scope)  # noqa: S102 - our own page
    printed = capsys.readouterr().out
    for line in re.findall(r"print\(\w+\) +# (.+)", "".join(blocks)):
        assert line.removesuffix("...").rstrip() in printed
    assert {path.name for path in tmp_path.iterdir()} == {"eia.png", "views.zip", "cross.zip"}


def test_the_notebook_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((ROOT / "examples" / "light_field.ipynb").read_text(encoding="utf-8"))
    scope = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "light_field.ipynb", "exec"), scope)  # noqa: S102 - our own notebook
    assert scope["psnr"](scope["large"].view(2, 2)) > scope["psnr"](scope["simple"]) + 1
    assert {path.name for path in tmp_path.iterdir()} == {"eia.png", "views.zip"}
