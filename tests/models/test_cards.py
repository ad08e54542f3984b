import json

import pytest

from ciir.errors import BadCard
from ciir.models import cards
from ciir.models.catalogue import SHIPPED

PAPER = SHIPPED / "paper.json"


def write_edited(tmp_path, **changes):
    """Writes paper's card with `changes`, `...` removing a key; returns its path."""
    table = json.loads(PAPER.read_text()) | changes
    path = tmp_path / "paper.json"
    path.write_text(json.dumps({key: value for key, value in table.items() if value is not ...}))
    return path


def test_written_and_read_back(tmp_path):
    card = cards.read_card(PAPER)
    cards.write_card(card, tmp_path / "paper.json")
    assert cards.read_card(tmp_path / "paper.json") == card


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": ...}, "'scale' is missing"),
        ({"colour": "red"}, "'colour' is unknown"),
        ({"scale": "2"}, "scale is '2'; int is needed"),
        ({"scale": True}, "scale is True; int is needed"),
        ({"scale": 0}, "scale is 0; at least 1"),
        ({"radius": -1}, "radius is -1; at least 0"),
        ({"sha256": "abc"}, "64 hexadecimal digits"),
        ({"input": 3}, "input: a table is needed"),
        ({"input": {"name": "image"}}, "input: key 'dtype' is missing"),
        ({"accuracy": {}}, "accuracy is {}"),
        ({"accuracy": [{"data": "Set5", "pictures": 5, "psnr": "high", "ssim": 1.0}]}, "psnr is 'high'; float"),
        ({"training": {"recipe": [], "commit": "", "iterations": 1, "seed": 0}}, r"recipe is \[\]; dict"),
        ({"name": "other"}, "names its network 'other'"),
        ({"precision": "float16"}, "precision is 'float16'; give one of float32, int8"),
        ({"runs": 2}, "runs is 2; give 1, or 2 for a light-field network"),
        ({"sizes": {"minimum": 0}}, "at least 1 is needed"),
        ({"sizes": {"square": 1}}, "square is 1; bool"),
        ({"sizes": {"maximum": 9}}, "'maximum' is unknown"),
    ],
)
def test_a_bad_card_is_refused_in_one_line(tmp_path, changes, message):
    with pytest.raises(BadCard, match=message) as caught:
        cards.read_card(write_edited(tmp_path, **changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"\xff\xfe"])
def test_a_file_without_a_json_table_is_refused(tmp_path, text):
    path = tmp_path / "paper.json"
    path.write_bytes(text)
    with pytest.raises(BadCard, match=r"paper\.json"):
        cards.read_card(path)


def test_a_missing_card_is_refused(tmp_path):
    with pytest.raises(BadCard, match="No such file"):
        cards.read_card(tmp_path / "paper.json")


def test_optional_keys_have_defaults(tmp_path):
    card = cards.read_card(write_edited(tmp_path, precision=..., float_twin=..., sizes=...))
    assert (card.precision, card.float_twin, card.sizes) == ("float32", "", cards.Sizes())
    card = cards.read_card(write_edited(tmp_path, sizes={"multiple_of": 4, "square": True}))
    assert card.sizes == cards.Sizes(minimum=8, multiple_of=4, square=True)


@pytest.mark.parametrize(
    ("sizes", "given", "expected"),
    [
        (cards.Sizes(), (1, 30), (8, 30)),
        (cards.Sizes(16, 8), (17, 3), (24, 16)),
        (cards.Sizes(10, 4), (1, 1), (12, 12)),
        (cards.Sizes(1, 2, square=True), (5, 9), (10, 10)),
        (cards.Sizes(1), (7, 1), (7, 1)),
    ],
)
def test_sizes_round_up(sizes, given, expected):
    assert sizes.round_up(*given) == expected


@pytest.mark.parametrize("planes", [1, "planes", None, ...])
def test_a_light_field_network_needs_its_inputs_and_two_planes(tmp_path, planes):
    """Those of earlier versions had `rows` and `cols`, and no filters (None). `...`: no axis at all."""
    table = json.loads((SHIPPED / "field.json").read_text())
    inputs = {tensor["name"]: tensor for tensor in table["extra_inputs"]}
    if planes is None:
        inputs["rows"] = inputs.pop("window") | {"name": "rows"}
    elif planes is ...:
        inputs["down"]["shape"] = []
    else:
        inputs["down"]["shape"][0] = planes
    path = tmp_path / "field.json"
    path.write_text(json.dumps(table | {"extra_inputs": list(inputs.values())}))
    with pytest.raises(BadCard, match="for at least 2 planes: export it again"):
        cards.read_card(path)
