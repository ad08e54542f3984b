"""Reading settings from the environment, and the errors for bad values."""

import re
from dataclasses import asdict, fields

import pytest

from ciir.errors import InvalidOption
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.service import settings
from ciir.service.pipeline.limits import SETTINGS, read_limits
from ciir.service.settings import Settings
from tests.support.paths import ROOT

NUMBERS = [name for name, field in Settings.model_fields.items() if field.annotation in (int, float)]


@pytest.fixture(autouse=True)
def unset_variables(monkeypatch):
    for name in Settings.model_fields:
        monkeypatch.delenv(f"CIIR_{name.upper()}", raising=False)


def test_settings_are_read_from_the_environment(monkeypatch, tmp_path):
    for name, value in {
        "CIIR_WORKERS": "3",
        "CIIR_SYNC_SECONDS": "0.5",
        "CIIR_FOLDER": str(tmp_path),
        "CIIR_QUEUE": "redis://localhost:6379/0",
        "CIIR_LOG_FORMAT": "json",
        "CIIR_API_KEYS": " first, second,first,",
        "CIIR_CORS_ORIGINS": "https://a.example,https://b.example",
    }.items():
        monkeypatch.setenv(name, value)
    found = settings.read_settings()
    assert (found.workers, found.sync_seconds, found.find_folder()) == (3, 0.5, tmp_path)
    assert (found.queue, found.log_format) == ("redis://localhost:6379/0", "json")
    assert [key.get_secret_value() for key in found.api_keys] == ["first", "second"]
    assert found.cors_origins == ("https://a.example", "https://b.example")
    assert "first" not in repr(found)


@pytest.mark.parametrize("value", ["s3:bucket", "S3:bucket/path", "s3:/bucket", "http:localhost", "memory://files"])
def test_places_that_keep_no_files_are_refused(monkeypatch, value):
    monkeypatch.setenv("CIIR_FILES", value)
    with pytest.raises(
        InvalidOption, match=f"CIIR_FILES: '{value}' is not a folder's path, or an address such as s3://"
    ):
        settings.read_settings()


@pytest.mark.parametrize(
    ("value", "expected"),
    [("shared", "{here}/shared"), ("./a:b", "{here}/a:b"), ("~/a", "{here}/home/a"), ("s3://b/p", "s3://b/p")],
)
def test_folders_have_absolute_paths(monkeypatch, tmp_path, value, expected):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("CIIR_FILES", value)
    monkeypatch.setenv("CIIR_FOLDER", "jobs")
    found = settings.read_settings()
    assert (found.files, found.find_folder()) == (expected.format(here=tmp_path), tmp_path / "jobs")


def test_an_empty_variable_counts_as_not_set(monkeypatch):
    for name in Settings.model_fields:
        monkeypatch.setenv(f"CIIR_{name.upper()}", "")
    assert settings.read_settings() == Settings()
    assert settings.read_settings().api_keys == ()


@pytest.mark.parametrize("name", ["CIIR_API_KEYS", "CIIR_QUEUE"])
def test_secrets_are_read_from_files(monkeypatch, tmp_path, name):
    path = tmp_path / "secret"
    path.write_text("redis://:swordfish@host/0\n")
    monkeypatch.setenv(f"{name}_FILE", str(path))
    found = settings.read_settings()
    assert found.queue == ("redis://:swordfish@host/0" if name == "CIIR_QUEUE" else "")
    keys = [key.get_secret_value() for key in found.api_keys]
    assert keys == (["redis://:swordfish@host/0"] if name == "CIIR_API_KEYS" else [])
    path.write_text("http://:swordfish@host" if name == "CIIR_QUEUE" else ",\n")
    with pytest.raises(InvalidOption, match=f"^{name}: ") as caught:
        settings.read_settings()
    assert "swordfish" not in str(caught.value)
    path.write_text(" \n")  # it would open the server, or mean a queue of its own
    with pytest.raises(InvalidOption, match=f"^{name}_FILE: {path} is empty; write {name} into it"):
        settings.read_settings()
    path.unlink()
    with pytest.raises(InvalidOption, match=f"{name}_FILE: .*No such file or directory; name a file"):
        settings.read_settings()
    monkeypatch.setenv(name, "redis://host")
    with pytest.raises(InvalidOption, match=f"{name} and {name}_FILE are both set"):
        settings.read_settings()


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_a_file_has_a_key_on_each_line(monkeypatch, tmp_path, mark):
    (tmp_path / "keys").write_bytes(mark + b"first\r\nsecond\nthird, fourth\n")
    monkeypatch.setenv("CIIR_API_KEYS_FILE", str(tmp_path / "keys"))
    keys = [key.get_secret_value() for key in settings.read_settings().api_keys]
    assert keys == ["first", "second", "third", "fourth"]


@pytest.mark.parametrize("name", ["CIIR_API_KEYS", "CIIR_QUEUE"])
def test_comments_in_a_file_are_no_keys(monkeypatch, tmp_path, name):
    (tmp_path / "secret").write_text("# keys of team A, until May\n\n  # the first\nredis://#1\n#")
    monkeypatch.setenv(f"{name}_FILE", str(tmp_path / "secret"))
    found = settings.read_settings()
    assert [found.queue, *(key.get_secret_value() for key in found.api_keys)] in (["redis://#1"], ["", "redis://#1"])
    (tmp_path / "secret").write_text("# nothing else\n")
    with pytest.raises(InvalidOption, match=f"^{name}_FILE: .* is empty"):
        settings.read_settings()


def test_hosts_are_compared_without_case_port_and_brackets(monkeypatch):
    monkeypatch.setenv("CIIR_HOSTS", "Example.org, foo.org:8000, [fd00::1]:80, FD00::2, 10.0.0.7, *")
    assert settings.read_settings().hosts == ("example.org", "foo.org", "fd00::1", "fd00::2", "10.0.0.7", "*")


@pytest.mark.parametrize("value", ["*.foo", "a.org,*.b", "http://foo.org", "foo.org/path", "me@foo.org", "[::1", ":80"])
def test_hosts_that_never_match_are_refused(monkeypatch, value):
    monkeypatch.setenv("CIIR_HOSTS", value)
    with pytest.raises(InvalidOption, match=re.escape(f"CIIR_HOSTS: {value!r} is not `*`, or whole names")):
        settings.read_settings()


def test_origins_are_those_that_browsers_send(monkeypatch):
    given = "https://Good.example:443, http://localhost:3000, http://[::1]:80, chrome-extension://abc, null, *"
    monkeypatch.setenv("CIIR_CORS_ORIGINS", given)
    expected = ("https://good.example", "http://localhost:3000", "http://[::1]", "chrome-extension://abc", "null", "*")
    assert settings.read_settings().cors_origins == expected


NO_ORIGINS = [
    "https://good.example/",
    "https://good.example/page",
    "example.org",
    "https://",
    "//example.org",
    "://a.org",
    "https:/a.org",
    "https://*.example",
    "https://me@good.example",
    "https://good.example:port",
    "https://a.org?b",
    "https://a.org#b",
    "https://gööd.org",
]


@pytest.mark.parametrize("value", NO_ORIGINS)
def test_origins_that_never_match_are_refused(monkeypatch, value):
    monkeypatch.setenv("CIIR_CORS_ORIGINS", value)
    with pytest.raises(
        InvalidOption, match=re.escape(f"CIIR_CORS_ORIGINS: {settings.hide_secrets(value)!r} is not `*`, or origins")
    ):
        settings.read_settings()


@pytest.mark.parametrize("name", ["CIIR_API_KEYS", "CIIR_CORS_ORIGINS"])
@pytest.mark.parametrize("value", [",", " ", " , ,"])
def test_an_empty_list_is_refused(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    with pytest.raises(InvalidOption, match=f"{name}: {value!r} is not "):
        settings.read_settings()


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("redis://localhost:6379/0", "redis://localhost:6379/0"),
        ("rediss://user:swordfish@host/0", "rediss://...@host/0"),
        ("redis://host/0?password=swordfish&db=1", "redis://host/0?..."),
        ("unix://:swordfish@/socket?username=me", "unix://...@/socket?..."),
        ("/srv/what?/a@b", "/srv/what?/a@b"),
    ],
)
def test_secrets_are_hidden_in_addresses(address, shown):
    assert settings.hide_secrets(address) == shown


def test_the_error_of_a_bad_address_hides_its_password(monkeypatch):
    monkeypatch.setenv("CIIR_QUEUE", "http://:swordfish@host")
    with pytest.raises(InvalidOption, match=r"//\.\.\.@host") as caught:
        settings.read_settings()
    assert "swordfish" not in str(caught.value)


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_are_limited(monkeypatch, name):
    least, most = re.fullmatch(r"a (?:whole )?number from (\S+) to (\S+)", settings.describe_values(name)).groups()
    for value in (least, most):
        monkeypatch.setenv(f"CIIR_{name.upper()}", value)
        assert getattr(settings.read_settings(), name) == float(value)
    for value in (str(float(least) - 1), str(2 * int(float(most)) + 1), "many", "nan", "inf"):
        monkeypatch.setenv(f"CIIR_{name.upper()}", value)
        with pytest.raises(InvalidOption) as caught:
            settings.read_settings()
        line = str(caught.value)
        assert line.startswith(f"CIIR_{name.upper()}: '{value}' is not {settings.describe_values(name)}; ")
        assert "for the default" in line


def test_a_default_that_is_empty_is_not_named(monkeypatch):
    monkeypatch.setenv("CIIR_HOSTS", "*.example")
    with pytest.raises(InvalidOption, match=r"; set one, or unset it$"):
        settings.read_settings()


@pytest.mark.parametrize(
    ("name", "value", "parts"),
    [
        ("CIIR_QUEUE", "http://localhost", "address of a Redis server"),
        ("CIIR_LOG_FORMAT", "xml", "text or json"),
        ("CIIR_WORKERS", "1.5", "whole number from 0 to 64"),
    ],
)
def test_bad_values_are_refused(monkeypatch, name, value, parts):
    monkeypatch.setenv(name, value)
    with pytest.raises(InvalidOption, match=parts) as caught:
        settings.read_settings()
    assert "\n" not in str(caught.value)


def test_an_unknown_name_is_logged(monkeypatch, caplog):
    monkeypatch.setenv("CIIR_WORKER", "3")
    settings.warn_of_unknown()
    assert "CIIR_WORKER is set" in caplog.text
    caplog.clear()
    monkeypatch.delenv("CIIR_WORKER")
    monkeypatch.setenv("CIIR_MODELS", "networks")
    settings.warn_of_unknown()
    assert caplog.text == ""


def test_the_default_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert Settings().find_folder() == tmp_path / "ciir" / "service"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert Settings().find_folder() == tmp_path / ".cache" / "ciir" / "service"

    def find_no_home():
        raise RuntimeError

    monkeypatch.setattr(settings.Path, "home", find_no_home)
    with pytest.raises(InvalidOption, match=r"CIIR_FOLDER: .*; name a folder"):
        Settings().find_folder()


def test_every_limit_on_inputs_is_a_setting():
    assert Settings().limits == DEFAULT_LIMITS
    values = {
        "max_files": 2,
        "max_unpacked_bytes": 2000,
        "max_ratio": 3,
        "max_pixels": 4,
        "max_set_bytes": 5,
        "max_triangles": 6,
        "max_views": 7,
    }
    limits = Settings(**values).limits
    assert sorted(getattr(limits, field.name) for field in fields(Limits)) == sorted(values.values())


@pytest.mark.parametrize("name", Settings.model_fields)
def test_every_setting_is_documented_and_used(name):
    assert len((Settings.model_fields[name].description or "").split()) > 3
    assert settings.describe_values(name)
    used = re.compile(rf"\b_?(?:settings|found)\.{name}\b")
    own = re.compile(rf"\bself\.{name}\b")
    assert any(
        used.search(text) or (path.name == "settings.py" and own.search(text))
        for path in (ROOT / "service").rglob("*.py")
        if (text := path.read_text(encoding="utf-8"))
    ), "no code reads it"


def test_the_server_and_the_commands_read_the_same_limits(monkeypatch):
    assert Settings().limits == read_limits() == Limits()
    for number, (name, least, _) in enumerate(SETTINGS.values()):
        monkeypatch.setenv(name, str(least + 1000 + number))
    assert Settings().limits == read_limits()
    assert len(set(asdict(read_limits()).values())) == len(SETTINGS) == len(fields(Limits))
