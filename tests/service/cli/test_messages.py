"""Errors and notes of the command line."""

import ast
import re
from pathlib import Path

import pytest

from ciir.service.cli.main import main
from ciir.service.cli.messages import format_message
from ciir.service.pipeline.options import OPTIONS
from tests.support.cli import fails

ROOT = Path(__file__).parents[3]
NAMES = "|".join(OPTIONS)
HALF = re.compile(
    rf"--[a-z-]+( [^ ;:]+)?(,| and| or|, and|, or) ({NAMES})(?=[;,.)]|$| (and|or|out|too)\b)"
    rf"|(?<![\w-])(?<!fewer )({NAMES})(,| and| or|, and|, or) --[a-z]"
    rf"|(?<![\w-])({NAMES}) (\d+x\d+|[A-Z]+x[A-Z]+|auto|none)(?![\w.])"
)
"""An option that is written as a plain word next to one that is typed, or before its value."""
PROSE = re.compile(r"--(views|pixels|lenses|frames|points) (of|per|in|with|are|is|have)\b|\b(a|an|the|its|their) --\w")
"""Words that are taken for options by mistake."""


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("lens_pitch: this is not one;\nleave lens_pitch out", "--lens-pitch: this is not one; leave --lens-pitch out"),
        ("give lens_pitch, lens_offset\tand lens_grid.", "give --lens-pitch, --lens-offset and --lens-grid."),
        ("lenses: 3x3 does not divide it; give crop", "--lenses: 3x3 does not divide it; give --crop"),
        ("show_grid: needs lens_pitch", "--show-grid: needs --lens-pitch"),
        ("lens_pitch.png: give lens_pitch auto", "lens_pitch.png: give --lens-pitch auto"),
        (
            "give one of disparity, depth, stack and all_in_focus",
            "give one of --disparity, --depth, --stack and --all-in-focus",
        ),
        (
            "give pitch and delta of its lens array, or camera_pitch, focal_length and sensor in millimetres",
            "give --pitch and --delta of its lens array, or --camera-pitch, --focal-length and --sensor in millimetres",
        ),
        ("fewer lenses, a smaller scale or strategy direct", "fewer lenses, a smaller scale or --strategy direct"),
        ("as in lenses 50x50 (rows x columns)", "as in --lenses 50x50 (rows x columns)"),
        ("order: they seem wrong; order columns reads them", "--order: they seem wrong; --order columns reads them"),
        ("give depth_sense lenses, and views of one size", "give --depth-sense lenses, and views of one size"),
        ("give depth, or stack with stack_of depths", "give --depth, or --stack with --stack-of depths"),
        ("fit, place: with fit none it stays", "--fit, --place: with --fit none it stays"),
        ("a layout such as quilt 8x6 aspect 0.75", "a layout such as --quilt 8x6 --aspect 0.75"),
        ("with depth_factor 0.37, or zoom 0.66, all", "with --depth-factor 0.37, or --zoom 0.66, all"),
        ("pixels gives another grid of views", "--pixels gives another grid of views"),
    ],
)
def test_options_are_written_as_they_are_typed(text, line):
    assert format_message(text, []) == line


def test_the_first_word_of_a_note_may_be_plain():
    assert format_message("depth: give depth_sense lenses") == "depth: give --depth-sense lenses"
    assert format_message("views: 5x5, in rows") == "views: 5x5, in rows"
    assert format_message("order: wrong; order given keeps it") == "--order: wrong; --order given keeps it"


def list_messages():
    """Returns the sentences in the code, with `it` for what is filled in."""

    def read(node):
        if isinstance(node, ast.JoinedStr):
            return "".join(part.value if isinstance(part, ast.Constant) else "it" for part in node.values)
        return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""

    found = set()
    for path in (path for folder in ("renderer", "models", "service") for path in (ROOT / folder).rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        parts = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
        parts |= {id(node.value) for node in nodes if isinstance(node, ast.Expr)}  # docstrings
        found |= {read(node) for node in nodes if id(node) not in parts}
    return sorted(" ".join(text.split()) for text in found if " " in text)


def test_no_message_spells_options_in_two_ways():
    messages = list_messages()
    lines = [format_message(text, []) for text in messages]
    assert sum("--" in line and line != text for line, text in zip(lines, messages, strict=True)) > 150
    assert not [line for line in lines if "--" in line and HALF.search(line)]
    assert not [line for line, text in zip(lines, messages, strict=True) if line != text and PROSE.search(line)]


@pytest.mark.parametrize("name", [name for name in OPTIONS if "_" in name])
@pytest.mark.parametrize("pattern", ["{}.png", "in/{}", "{}/a.png", "my_{}", "{}_2", "{}-2", "a-{}", "--{}", "'{}'"])
def test_other_names_are_kept(name, pattern):
    assert format_message(f"{pattern.format(name)}: no such file") == f"{pattern.format(name)}: no such file"


def test_words_of_the_arguments_are_kept():
    text = "my lens_pitch: is not a picture; give lens_pitch or lens_grid"
    assert format_message(text, ["my lens_pitch"]) == "my lens_pitch: is not a picture; give lens_pitch or --lens-grid"
    given = ["in/lens_pitch.png", "--lens-pitch"]
    assert format_message("give lens_pitch", given) == "give --lens-pitch"
    assert format_message("depth: no such folder", ["in/depth"]) == "depth: no such folder"


@pytest.mark.parametrize("given", [["--to", "quilt"], ["a.png", "--depth-sense", "quilt"], ["--to=quilt"]])
def test_values_of_options_are_no_words_that_are_kept(given):
    assert format_message("quilt: '8x' is not understood", given) == "--quilt: '8x' is not understood"
    assert format_message("quilt: no such file", [*given, "--transpose", "quilt"]) == "quilt: no such file"


def test_errors_and_notes_of_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "all_in_focus").write_bytes(b"not a picture")
    assert "--stack and --all-in-focus" in fails(capsys, "refocus", "scene:vase", "-o", "a.png")
    assert fails(capsys, "refocus", "all_in_focus", "--disparity", "0", "-o", "a.png").startswith("ciir: all_in_focus:")
    assert "ciir: --view: " in fails(capsys, "depth", "scene:vase", "--view", "a", "-o", "a.pfm")
    argv = ["reconstruct", "scene:vase", "--lenses", "5x5", "--neighbour-time", "0", "-o", "a.png"]
    monkeypatch.setattr("ciir.service.pipeline.run.fallback_notes", lambda *_, **__: ["neighbour_time allows none"])
    assert main(argv) == 0
    assert "ciir: note: --neighbour-time allows none\n" in capsys.readouterr().err
