"""The shipped networks keep their margins to the limits of number formats."""

import pytest

from ciir.benchmarks.stress.case import Effort
from ciir.benchmarks.stress.networks.layers import activations, saturation
from ciir.models import catalogue


@pytest.mark.parametrize("case", [activations, saturation])
def test_shipped_networks_hold_their_bounds(case):
    pytest.importorskip("onnx", reason="needs the training extra")
    names = tuple(name for name in catalogue.list_single_image_names() if name not in catalogue.BASELINES)
    found = list(case(Effort(names)))
    assert len(found) >= 6
    assert [each for each in found if not each.measured <= each.bound] == []
