import subprocess
import sys

import pytest

from benchmarks import cold


def test_what_is_not_known_is_refused(capsys):
    assert cold.main(["disk"]) == 2
    assert "give opengl or network" in capsys.readouterr().err


def test_the_start_of_a_network_is_more_than_nothing():
    assert cold.start("network", 1) > 0


def test_a_command_that_fails_is_no_time():
    with pytest.raises(subprocess.CalledProcessError):
        cold._output([sys.executable, "-c", "raise SystemExit(2)"])
