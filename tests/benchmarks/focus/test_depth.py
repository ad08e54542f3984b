import numpy as np
import pytest

from ciir.benchmarks.focus.depth import HEAD, HEAD_UPSCALED, main, measure_peak
from ciir.errors import InvalidOption


def test_a_line_for_each_scene_and_the_mean(capsys, tmp_path):
    assert main(["--meshes", str(tmp_path), "--only", "vase", "--side", "48"]) == 0
    missing, head, vase, mean = capsys.readouterr().out.splitlines()
    assert "spot, fuze" in missing
    assert head == HEAD
    assert len(vase) == len(mean) == len(head)
    assert vase.split()[1:] == mean.split()[1:]


def test_noise_and_upscaled_views_are_compared(capsys, tmp_path):
    """At such sizes the figures say nothing: the lines have to be there."""
    arguments = ["--meshes", str(tmp_path), "--only", "vase", "--side", "48"]
    main([*arguments, "--noise", "40"])
    noisy = capsys.readouterr().out.splitlines()[-1].split()
    main(arguments)
    assert float(noisy[4]) > float(capsys.readouterr().out.splitlines()[-1].split()[4])
    main([*arguments, "--upscale"])
    _, head, line, mean = capsys.readouterr().out.splitlines()
    assert head == HEAD_UPSCALED
    assert len(line) == len(mean) == len(head)


def test_unknown_scenes_are_refused(tmp_path):
    with pytest.raises(InvalidOption, match=r"--only: no duck\.glb; there are vase"):
        main(["--meshes", str(tmp_path), "--only", "duck.glb"])


def test_memory_that_is_freed_again_counts():
    peak, added = measure_peak(lambda: np.ones(64 << 17).sum())  # 64 MB: more than any allocator keeps
    if peak == 0:
        pytest.skip("this system doesn't count it")
    assert 60 <= added <= peak
