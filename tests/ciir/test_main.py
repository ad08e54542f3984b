import sys
import tomllib
from pathlib import Path

from ciir.__main__ import main

MODULE = "ciir.service.cli.main"


class InterruptedImport:
    """A finder of modules that is interrupted at the command line's."""

    @staticmethod
    def find_spec(name, *_):
        if name == MODULE:
            raise KeyboardInterrupt


def test_ctrl_c_while_modules_are_imported(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, MODULE, raising=False)
    monkeypatch.setattr(sys, "meta_path", [InterruptedImport, *sys.meta_path])
    assert main() == 130
    assert capsys.readouterr().err == "ciir: interrupted\n"


def test_the_installed_command_is_the_same():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert project["scripts"]["ciir"] == f"{main.__module__}:main"
