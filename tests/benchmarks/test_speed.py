from ciir.benchmarks import speed


def test_int8_networks_are_timed_against_their_twins(monkeypatch, capsys):
    monkeypatch.setattr(speed, "SIZES", ((8, 9),))
    assert speed.main(["--only", "int8", "--rounds", "1"]) == 0
    assert "fast-int8      9x8, 1 core(s): float" in capsys.readouterr().out


def test_a_bound_that_does_not_hold_is_reported(monkeypatch, capsys):
    lines = [("3 at most 2", False), ("1 at most 2", True), ("2 rounds", None)]
    monkeypatch.setitem(speed.PARTS, "int8", lambda mesh, rounds: iter(lines))
    assert speed.main(["--only", "int8"]) == 1
    assert capsys.readouterr().out == "3 at most 2: DOES NOT HOLD\n1 at most 2: holds\n2 rounds\n"
