import pytest

from ciir.renderer.readers.names import clean_text, is_hidden, resolve_key


@pytest.mark.parametrize(
    ("name", "folder", "key"),
    [
        ("a.png", "", "a.png"),
        ("a b.png", "models", "models/a b.png"),
        ("./x/../a.png", "", "a.png"),
        ("../a.png", "models", "a.png"),  # out of the mesh's folder, yet within the bundle
    ],
)
def test_names_within_are_normalised(name: str, folder: str, key: str) -> None:
    assert resolve_key(name, folder) == key


@pytest.mark.parametrize(
    "name", ["", "..", "../a", "a/../../b", "/etc/passwd", "C:/a", "c:a", "a\\b", "a\0b", "http://x/y", "file:///etc/x"]
)
def test_names_that_lead_out_are_refused(name: str) -> None:
    assert resolve_key(name) is None


def test_a_name_shown_is_one_short_line() -> None:
    assert clean_text("a\nb\x1b[31m.obj") == "a?b?[31m.obj"
    assert len(clean_text("x" * 1000)) == 80


def test_hidden_files() -> None:
    assert all(is_hidden(key) for key in (".a", "m/.DS_Store", ".git/a", "__MACOSX/m/a.png"))
    assert not any(is_hidden(key) for key in ("a.b", "m/a", "a/__MAC"))
