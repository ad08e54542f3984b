from ciir.benchmarks import reading


def test_every_container_is_read(capsys):
    reading.main(["--grid", "3", "--side", "32", "--rounds", "1"])
    rows = capsys.readouterr().out.splitlines()[2:]
    assert [row.split("|")[1].strip() for row in rows] == list(reading.CASES)
