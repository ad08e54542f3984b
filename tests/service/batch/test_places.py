import pytest
from fsspec.implementations.memory import MemoryFileSystem

from ciir.errors import InvalidOption
from ciir.service.batch.places import Outputs


@pytest.mark.parametrize(("error", "raised"), [(RuntimeError, InvalidOption), (TypeError, TypeError)])
def test_an_error_of_the_store_is_reported_and_a_programming_error_stays(monkeypatch, error, raised):
    def fail(*_, **__):
        raise error("no answer")

    monkeypatch.setattr(MemoryFileSystem, "cat_file", fail)
    with pytest.raises(raised, match="no answer"):
        Outputs("memory://outputs")
