import json
import math

import pytest

from ciir.benchmarks.stress import run as stress
from ciir.benchmarks.stress.case import Effort, Found, Skipped
from ciir.models import processor
from ciir.service.cli.main import main
from tests.support.paths import ROOT


def good(effort):
    yield Found("small enough", 2.0, 1.0, "here")
    yield Skipped("torch", "needs torch: pip install 'ciir[training]'")


def broken(effort):
    yield Found("too large", 1.0, math.inf, "there")


def raises(effort):
    yield Found("before", 1.0, 0.5)
    raise ArithmeticError("first line\nsecond line")


@pytest.fixture
def cases(monkeypatch):
    """Groups `fine` and `bad`, in place of all."""

    class Module:
        def __init__(self, *cases):
            self.CASES = cases

    modules = {"fine": Module(good), "bad": Module(raises, broken)}
    monkeypatch.setattr(stress, "GROUPS", {name: name for name in modules})
    monkeypatch.setattr(stress.importlib, "import_module", modules.__getitem__)


def results(groups):
    lines = []
    found = stress.stress(groups, Effort(("fast",)), write=lines.append)
    return found, lines


def test_what_holds(cases):
    found, lines = results(["fine"])
    assert found["broken"] == 0
    assert lines[1].startswith("ok       small enough")
    assert lines[1].split()[-3:] == ["2", "1", "here"]
    assert lines[2] == "skipped  torch: needs torch: pip install 'ciir[training]'"
    assert lines[-1].startswith("1 hold, 0 broken, 1 skipped")
    assert [result["state"] for result in found["results"]] == ["ok", "skipped"]


def test_what_breaks_and_what_raises_do_not_stop_the_others(cases):
    found, lines = results(["bad", "fine"])
    assert found["broken"] == 2
    by_state = [(result["state"], result["case"]) for result in found["results"]]
    assert by_state == [
        ("ok", "raises"),
        ("BROKEN", "raises"),
        ("BROKEN", "broken"),
        ("ok", "good"),
        ("skipped", "good"),
    ]
    assert found["results"][1]["failure"] == "ArithmeticError: first line second line"
    assert "ArithmeticError: first line second line" in lines[2]
    assert "\n" not in lines[2]


def test_json_has_no_infinity_but_says_what_it_was(cases):
    found, _ = results(["bad"])
    text = json.dumps(found, allow_nan=False)
    assert [result["measured"] for result in json.loads(text)["results"]] == [0.5, None, None]
    assert found["results"][1]["measured_word"] == "nan"
    assert found["results"][2]["measured_word"] == "inf"
    assert found["machine"]["cores"] >= 1


@pytest.mark.parametrize(("measured", "broken"), [(0, 0), (2, 1)])
def test_the_command_ends_with_1_where_a_bound_breaks(monkeypatch, capsys, tmp_path, measured, broken):
    outcome = stress.Outcome("rounds", "x", Found("x", 1, measured), 0)
    monkeypatch.setattr(stress, "run_case", lambda group, case, effort: iter([outcome]))
    out = tmp_path / "results.json"
    arguments = ["stress", "--quick", "--only", "rounds", "--model", "fast", "--json", str(out)]
    if broken:
        with pytest.raises(SystemExit, match="1"):
            main(arguments)
    else:
        assert main(arguments) == 0
    written = json.loads(out.read_text())
    assert (written["quick"], written["models"], written["groups"]) == (True, ["fast"], ["rounds"])
    assert written["broken"] == broken
    assert f"{1 - broken} hold, {broken} broken" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("option", "value", "named"),
    [
        ("--only", "nothing", "geometry"),
        ("--model", "bicubic", "fast"),
        ("--json", "", "--json"),
        ("--json", ".", "folder"),
    ],
)
def test_options_are_checked_before_any_work(option, value, named, capsys):
    assert main(["stress", option, value]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert named in line


def test_int8_is_skipped_where_the_processor_gets_it_wrong(monkeypatch):
    monkeypatch.setattr(processor, "int8_unsupported_reason", lambda: "this processor has no VNNI")
    chosen, skipped = stress.select_models(["fast", "fast-int8"])
    assert chosen == ("fast",)
    assert [(each.what, "VNNI" in each.why) for each in skipped] == [("fast-int8", True)]


def test_the_page_explains_every_group():
    page = (ROOT / "docs" / "numerics.md").read_text(encoding="utf-8")
    assert [name for name in stress.GROUPS if f"`{name}`" not in page] == []
