import dataclasses
import json

from ciir import models
from ciir.service.cli.main import main


def test_models(capsys):
    assert main(["models"]) == 0
    text = capsys.readouterr().out
    assert main(["models", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [model["name"] for model in listed] == models.list_names()
    assert all(model["name"] in text for model in listed)
    assert [model["name"] for model in listed if model["default"]] == [models.picture_default_name()]
    assert [model["name"] for model in listed if model["takes"] != "a picture"] == [
        "field",
        "field-int8",
        "field-quality",
        "field-quality-int8",
    ]
    assert "model auto, which `ciir reconstruct` uses unless another is named: field for a mesh" in text


def test_models_says_which_are_not_for_this_machine(capsys, monkeypatch):
    entries = [
        dataclasses.replace(
            entry, card=entry.card and dataclasses.replace(entry.card, precision="int8", float_twin="slow")
        )
        for entry in models.list_entries()
    ]
    monkeypatch.setattr(models.catalogue, "list_entries", lambda: entries)
    monkeypatch.setattr(models.catalogue.processor, "int8_unsupported_reason", lambda: "this processor has no VNNI")
    assert main(["models"]) == 0
    text = capsys.readouterr().out
    assert f"{models.catalogue.FALLBACK} does not run on this machine: this processor has no VNNI; use slow" in text
    assert "bicubic is not" not in text
    assert main(["models", "--json"]) == 0
    listed = {model["name"]: model for model in json.loads(capsys.readouterr().out)}
    assert listed[models.catalogue.FALLBACK]["unsupported_reason"] == "this processor has no VNNI"
    assert listed["bicubic"]["unsupported_reason"] is None
