"""The engines of a batch."""

import pytest

from ciir.errors import InvalidOption
from ciir.service.batch import engines


@pytest.mark.parametrize("address", ["scheduler", "tcp://scheduler", "tcp://scheduler:port", "http://scheduler:8786"])
def test_an_address_that_is_none_is_refused_at_once(monkeypatch, address):
    monkeypatch.setattr(engines, "Client", None)  # one that refuses an address itself takes a minute to end
    with pytest.raises(InvalidOption, match=f"no scheduler answers at {address} .* such as tcp://10.0.0.1:8786$"):
        engines.connect(address)
