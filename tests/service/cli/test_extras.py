"""Commands without the packages of their extra."""

import sys

import pytest

from ciir import service
from ciir.errors import InvalidOption
from ciir.service.cli.extras import EXTRAS, require_extra
from ciir.service.cli.main import main


@pytest.mark.parametrize("command", EXTRAS)
def test_a_missing_package_names_the_extra(command):
    remedy = rf"{command}: the package absent .*'\.\[{EXTRAS[command]}\]'"
    with pytest.raises(InvalidOption, match=remedy), require_extra(command):
        import absent.part  # noqa: F401


@pytest.mark.parametrize(("command", "name"), [("models", "absent"), ("serve", "ciir.absent")])
def test_any_other_missing_module_is_an_error_of_ours(command, name):
    with pytest.raises(ModuleNotFoundError), require_extra(command):
        __import__(name)


def test_serve_in_the_core_alone(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "ciir.service.settings", raising=False)
    monkeypatch.delattr(service, "settings", raising=False)
    monkeypatch.setitem(sys.modules, "pydantic_settings", None)
    assert main(["serve"]) == 2
    assert capsys.readouterr().err == (
        "ciir: serve: the package pydantic_settings is not installed; run pip install '.[service]' in the folder of "
        "ciir's source code\n"
    )


@pytest.mark.parametrize("argv", [["evaluate", "fast", "absent"], ["train", "absent.toml", "-o", "out"]])
def test_scikit_image_is_looked_for_before_any_work(monkeypatch, capsys, argv):
    """It was missed after a network had upscaled the first picture."""
    monkeypatch.setitem(sys.modules, "skimage", None)
    monkeypatch.setattr("ciir.service.cli.commands.training.run", pytest.fail)
    assert main(argv) == 2
    assert "the package skimage is not installed; run pip install '.[bench]' in the folder" in capsys.readouterr().err


def test_bench_looks_for_matplotlib_before_its_work(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["bench", "-o", str(tmp_path / "out")]) == 2
    assert "pip install '.[bench]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
