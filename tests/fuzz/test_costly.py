import contextlib

import pytest

from ciir.errors import InvalidGeometry, InvalidOption, TooLarge, UnsupportedType
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from tests.fuzz import costly

SMALL = sorted(set(costly.CASES) - {"black", "scans"})
"""The two others are as large as pictures may be, and take seconds."""


@pytest.mark.parametrize("case", SMALL)
def test_every_case_is_what_it_says_and_is_read_or_refused(case):
    made = costly.CASES[case](30_000)
    assert 5_000 < len(made.data) < 300_000
    bundle = Bundle.from_upload(made.name, made.data)  # a file of the kind that its name says
    with contextlib.suppress(
        TooLarge, InvalidGeometry, InvalidOption, UnsupportedType
    ):  # Unreadable would be a case that is broken
        inputs.read(bundle, lenses=None, pixels=(1, 1))
