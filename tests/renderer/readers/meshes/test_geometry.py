import numpy as np

from ciir.renderer.readers.meshes.geometry import normalise


def test_normalised() -> None:
    assert normalise(np.array([0, 255], np.uint8)).tolist() == [0, 1]
    assert normalise(np.array([-32768, -32767, 32767], np.int16)).tolist() == [-1, -1, 1]
    assert normalise(np.array([0.5, 3.0])).tolist() == [0.5, 3.0]
