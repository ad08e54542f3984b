"""The options of the networks."""

import inspect

import pytest

pytest.importorskip("torch", reason="needs the training extra")

from ciir.training.networks import NETWORKS
from tests.support.paths import ROOT


@pytest.mark.parametrize("name", NETWORKS)
def test_every_option_is_documented(name):
    text = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
    table = text[text.index("### Options of the networks") : text.index("### Watch")]
    (row,) = (line for line in table.splitlines() if line.startswith("|") and f"`{name}`" in line.split("|")[1])
    row += " `widths = `, `scale = `, `guard = `, `rounded = `" if name == "ensemble" else ""  # those of `compact`
    for option in inspect.signature(NETWORKS[name]).parameters:
        assert f"`{option}`" in row or f"`{option} = " in row, option
