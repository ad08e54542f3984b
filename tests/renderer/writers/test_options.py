import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.writers.options import WriterOptions


def test_none_is_the_default_and_numbers_of_numpy_are_numbers():
    assert WriterOptions.convert({"fps": None, "aspect": None}) == WriterOptions()
    made = WriterOptions.convert({"frames": np.int64(5), "fps": np.float32(24.5), "disparity": np.float64(-0.5)})
    assert made == WriterOptions(frames=5, fps=24.5, disparity=-0.5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"frames": True}, "frames: 'True' is not accepted; give a whole number"),
        ({"frames": 2.5}, "frames: '2.5' is not accepted; give a whole number"),
        ({"fps": "fast"}, "fps: 'fast' is not accepted; give a number"),
        ({"fps": np.float64("nan")}, "fps: nan is out of range; give "),
        ({"device": 3}, "device: '3' is not accepted; give text"),
        ({"calibration": 3}, "calibration: '3' is not accepted; give a path"),
        ({"display": b"x"}, "display: .* is not accepted; give a path"),
    ],
)
def test_other_values_are_refused(given, message):
    with pytest.raises(InvalidOption, match=message):
        WriterOptions.convert(given)
