import pytest

from ciir.errors import ConnectionFailed, Unauthorized
from ciir.renderer.readers.pictures import decode
from ciir.service.demo import over_http
from tests.support.servers import run_server

pytestmark = pytest.mark.slow


def test_the_pictures_of_a_scene_come_from_the_server(server, tmp_path, capsys):
    over_http.main(server, tmp_path / "out")
    views = ["view_00_02.png", "view_02_00.png", "view_02_02.png", "view_02_04.png", "view_04_02.png"]
    left = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert left == ["eia.png", "report.json", *views]
    for name in views:
        assert decode((tmp_path / "out" / name).read_bytes(), name=name).shape == (200, 200, 3)
    assert server in capsys.readouterr().out


def test_a_server_with_keys(tmp_path, monkeypatch):
    with run_server(tmp_path / "log", CIIR_API_KEYS="first,second", CIIR_WORKERS="1") as server:
        with pytest.raises(Unauthorized):
            over_http.main(server.url, tmp_path / "out")
        monkeypatch.setenv("CIIR_API_KEYS", "second")
        over_http.main(server.url, tmp_path / "out")
    assert (tmp_path / "out" / "report.json").exists()


def test_a_server_that_is_not_there(monkeypatch, tmp_path):
    monkeypatch.setattr(over_http, "PATIENCE_SECONDS", 0)
    with pytest.raises(ConnectionFailed):
        over_http.main("http://127.0.0.1:9", tmp_path)
