from ciir.benchmarks.focus.model import HEAD, main

CUBE = "\n".join(
    ["OFF", "8 6 0"]
    + [f"{x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    + [f"4 {face}" for face in ("0 1 3 2", "4 6 7 5", "0 4 5 1", "2 3 7 6", "0 2 6 4", "1 5 7 3")]
)


def test_prints_a_line_for_each_mesh(tmp_path, capsys):
    for name in ("cube", "other"):
        (tmp_path / f"{name}.off").write_text(CUBE)
    assert main(["--meshes", str(tmp_path), "--only", "cube", "--lenses", "24", "--pixels", "5"]) == 0
    head, line = capsys.readouterr().out.splitlines()
    assert head == HEAD
    name, mean, worst, between, moved, median, most, triangles, _ = line.split()
    assert name == "cube"
    assert 50 > float(mean) >= float(worst) > 10  # the cube is ten lenses wide, and most of it edges
    assert 50 > float(between) > 10
    assert 50 > float(moved) > 10
    assert 0 <= float(median) <= float(most) < 0.5
    assert int(triangles.replace(",", "")) > 24
