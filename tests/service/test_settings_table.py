import re

from ciir.service import settings_table
from ciir.service.cli.main import main
from ciir.service.settings import Settings
from tests.support.paths import ROOT


def test_the_page_is_current():
    path = ROOT / "docs" / "settings.md"
    assert path.read_text(encoding="utf-8") == settings_table.format_page(), (
        "python -m ciir.service.settings_table > docs/settings.md"
    )


OTHERS = {
    "renderer.backends.opengl.MAX_SIDE": "larger pictures are rendered by Embree",
    "renderer.shading.MAX_FACES": "more faces at a position are flat",
    "renderer.sampling.MAX_SAMPLES": "no request reaches it",
    "renderer.readers.meshes.texture_files.MAX_NOTES": "limits the notes of a report",
}
"""Constants of such names that do not limit input."""


def test_every_fixed_limit_is_on_the_page():
    found = set()
    for folder in ("renderer", "service"):
        for path in (ROOT / folder).rglob("*.py"):
            if "writers" in path.parts:  # limits of output formats
                continue
            names = re.findall(r"^(MAX_[A-Z_]+)\b.*=", path.read_text(encoding="utf-8"), re.MULTILINE)
            found |= {".".join([*path.relative_to(ROOT).with_suffix("").parts, name]) for name in names}
    assert found - set(OTHERS) == {place for place in settings_table.FIXED_LIMITS if ".MAX_" in place}


def test_serve_shows_the_settings_without_secrets(monkeypatch, capsys):
    monkeypatch.setenv("CIIR_WORKERS", "5")
    monkeypatch.setenv("CIIR_API_KEYS", "swordfish,other")
    monkeypatch.setenv("CIIR_QUEUE", "redis://user:swordfish@example.org:6379/0")
    assert main(["serve", "--show-settings"]) == 0
    shown = capsys.readouterr().out
    for line in (
        "CIIR_WORKERS=5  (default: 2)",
        "CIIR_API_KEYS=2 keys  (default: none)",
        "CIIR_QUEUE=redis://...@example.org:6379/0  (default: none)",
    ):
        assert line in shown.splitlines()
    assert "swordfish" not in shown


def test_serve_reports_a_setting_out_of_range(monkeypatch, capsys):
    monkeypatch.setenv("CIIR_WORKERS", "65")
    assert main(["serve", "--show-settings"]) == 2
    assert "CIIR_WORKERS: '65'" in capsys.readouterr().err


OTHER_VARIABLES = {
    "CIIR_IMAGE": "docker-compose.yml",
    "CIIR_MODELS": "ciir/model_folder.py",
    "CIIR_PORT": "docker-compose.yml",
    "CIIR_TEST_CONTAINERS": "tests/containers/conftest.py",
}
"""Variables that are no settings of the service, and the file that reads them."""


def test_help_texts_and_docs_name_only_variables_that_exist():
    known = {f"CIIR_{name.upper()}" for name in Settings.model_fields} | set(OTHER_VARIABLES)
    paths = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("service/**/*.py")]
    paths += [ROOT / "Dockerfile", ROOT / "docker-compose.yml"]
    for path in paths:
        if path.name == "CHANGELOG.md":  # names what was removed
            continue
        named = set(re.findall(r"\bCIIR_[A-Z_]*[A-Z]\b", path.read_text(encoding="utf-8")))
        assert named <= known, path
    for name, reader in OTHER_VARIABLES.items():
        assert name in (ROOT / reader).read_text(encoding="utf-8")
