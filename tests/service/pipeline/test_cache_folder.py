import pytest

from ciir.service.pipeline import cache_folder


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"CIIR_CACHE": "/a", "XDG_CACHE_HOME": "/b", "HOME": "/c"}, "/a"),
        ({"XDG_CACHE_HOME": "/b", "HOME": "/c"}, "/b/ciir"),
        ({"HOME": "/c"}, "/c/.cache/ciir"),
    ],
)
def test_the_cache_folder(monkeypatch, environment, expected):
    for name in ("CIIR_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert str(cache_folder.folder()) == expected
