"""Errors and notes of the command line."""

import pytest

from ciir.service.cli.main import main
from ciir.service.cli.messages import format_message
from ciir.service.pipeline.options import OPTIONS
from tests.support.cli import fails


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("lens_pitch: this is not one;\nleave lens_pitch out", "--lens-pitch: this is not one; leave --lens-pitch out"),
        ("give lens_pitch, lens_offset\tand lens_grid.", "give --lens-pitch, --lens-offset and --lens-grid."),
        ("lenses: 3x3 does not divide it; give crop", "lenses: 3x3 does not divide it; give crop"),
        ("show_grid: needs lens_pitch", "--show-grid: needs --lens-pitch"),
        ("lens_pitch.png: give lens_pitch auto", "lens_pitch.png: give --lens-pitch auto"),
    ],
)
def test_options_are_written_as_they_are_typed(text, line):
    assert format_message(text) == line


@pytest.mark.parametrize("name", [name for name in OPTIONS if "_" in name])
@pytest.mark.parametrize("pattern", ["{}.png", "in/{}", "{}/a.png", "my_{}", "{}_2", "{}-2", "a-{}", "--{}", "'{}'"])
def test_other_names_are_kept(name, pattern):
    assert format_message(f"{pattern.format(name)}: no such file") == f"{pattern.format(name)}: no such file"


def test_words_of_the_arguments_are_kept():
    text = "my lens_pitch: is not a picture; give lens_pitch or lens_grid"
    assert format_message(text, ["my lens_pitch"]) == "my lens_pitch: is not a picture; give lens_pitch or --lens-grid"
    given = ["in/lens_pitch.png", "--lens-pitch"]
    assert format_message("give lens_pitch", given) == "give --lens-pitch"


def test_errors_and_notes_of_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "all_in_focus").write_bytes(b"not a picture")
    assert "stack and --all-in-focus" in fails(capsys, "refocus", "scene:vase", "-o", "a.png")
    assert fails(capsys, "refocus", "all_in_focus", "--disparity", "0", "-o", "a.png").startswith("ciir: all_in_focus:")
    argv = ["reconstruct", "scene:vase", "--lenses", "5x5", "--neighbour-time", "0", "-o", "a.png"]
    monkeypatch.setattr("ciir.service.pipeline.run.fallback_notes", lambda *_, **__: ["neighbour_time allows none"])
    assert main(argv) == 0
    assert "ciir: note: --neighbour-time allows none\n" in capsys.readouterr().err
