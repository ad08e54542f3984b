import pytest

from ciir.errors import ConnectionFailed
from ciir.renderer.readers.pictures import decode
from ciir.service.demo import over_http

pytestmark = pytest.mark.slow


def test_the_pictures_of_a_scene_come_from_the_server(server, tmp_path, capsys):
    over_http.main(server, tmp_path / "out")
    views = ["view_00_02.png", "view_02_00.png", "view_02_02.png", "view_02_04.png", "view_04_02.png"]
    left = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert left == ["eia.png", "report.json", *views]
    for name in views:
        assert decode((tmp_path / "out" / name).read_bytes(), name=name).shape == (200, 200, 3)
    assert server in capsys.readouterr().out


def test_a_server_that_is_not_there(monkeypatch, tmp_path):
    monkeypatch.setattr(over_http, "PATIENCE_SECONDS", 0)
    with pytest.raises(ConnectionFailed):
        over_http.main("http://127.0.0.1:9", tmp_path)
