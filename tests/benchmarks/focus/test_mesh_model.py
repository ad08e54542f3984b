from ciir.benchmarks.focus import mesh_model
from tests.benchmarks.focus.test_model import CUBE


def test_a_line_has_the_psnr_at_each_turn(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(mesh_model, "LENSES", 60)
    for name in ("cube", "other"):
        (tmp_path / f"{name}.off").write_text(CUBE)
    assert mesh_model.main(["--meshes", str(tmp_path), "--only", "cube", "--rotate", "30"]) == 0
    head, line = capsys.readouterr().out.splitlines()
    assert head.split()[::2] == ["0", "20", "40"]
    name, *psnr = line.split()
    front, turned, side = map(float, psnr)
    assert name == "cube"
    assert 60 > front > turned > side > 10  # it sees less and less of the model
