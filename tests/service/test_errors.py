import pickle

import pytest

from ciir import errors
from ciir.service.errors import find_response, join_lines

CLASSES = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.Error)]


@pytest.mark.parametrize("kind", CLASSES)
def test_every_error_has_a_response(kind):
    row = find_response(kind(1))
    is_inputs_error = issubclass(kind, errors.InputError | errors.ModelError) and kind is not errors.BadCard
    is_callers_error = is_inputs_error or kind is errors.BackendUnavailable
    assert (row.status in (413, 415, 422), row.exit) == (is_inputs_error, 2 if is_callers_error else 1)


@pytest.mark.parametrize("kind", CLASSES)
def test_errors_survive_pickling(kind):
    for error in (kind("message"), errors.TooLarge("message", "pixels", 3), errors.QueueFull("message", 7)):
        found = pickle.loads(pickle.dumps(error))  # noqa: S301 - its own
        assert (type(found), str(found), vars(found)) == (type(error), str(error), vars(error))


def test_messages_stay_one_line():
    assert join_lines("a\nb\r\n\tc  d") == "a b c d"
