import json

import pytest

from ciir.renderer.writers.writer import report_json


def test_json_is_utf8_and_refuses_nan():
    assert json.loads(report_json({"name": "Würfel"})) == {"name": "Würfel"}
    with pytest.raises(ValueError, match="Out of range"):
        report_json({"x": float("nan")})
