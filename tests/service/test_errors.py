import pytest

from ciir import errors
from ciir.service.errors import FAULTS, meaning, one_line


def descendants(kind):
    return {kind}.union(*(descendants(child) for child in kind.__subclasses__()))


@pytest.mark.parametrize("root", FAULTS)
def test_every_fault_has_a_meaning_that_both_doors_agree_on(root):
    for kind in descendants(root):
        row = meaning(kind("x"))
        assert (row.status < 500) == (row.exit == 2), kind
        assert row.exit in (1, 2)


@pytest.mark.parametrize(
    ("fault", "status"),
    [
        (errors.TooLarge("x"), 413),
        (errors.UnsupportedType("x"), 415),
        (errors.InvalidOption("x"), 422),
        (errors.BackendUnavailable("x"), 422),
        (errors.UnknownModel("x"), 422),
        (errors.BadCard("x"), 500),
        (errors.NotReady("x"), 503),
    ],
)
def test_status_codes(fault, status):
    assert meaning(fault).status == status


def test_what_is_not_in_the_table_has_no_meaning():
    with pytest.raises(LookupError, match="KeyError"):
        meaning(KeyError("x"))


def test_messages_stay_one_line():
    assert one_line("a\nb\r\n\tc  d") == "a b c d"
