"""Edits that make invalid bytes out of valid ones."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

from tests.fuzz import seeds

if TYPE_CHECKING:
    import random
    from collections.abc import Iterable, Iterator

Kind = Literal["flip", "put", "drop", "again", "cut"]
KINDS: tuple[Kind, ...] = get_args(Kind)
WORDS = (
    *(b"nan", b"-1", b"1e999", b"9" * 20, b"\0", b"\x1f", b"{}", b"[]", b"null", b"\n", b"\r\n", b" ", b"../", b"%s"),
    *(b"\xff" * 4, b"\x7f", b"/", b"0", b"#", b'"', b";", b"--bound", seeds.BETWEEN, "²é€".encode()),
)
"""Bytes that parsers often handle wrongly."""
MOST_BYTES = 40
"""Of one edit."""


VALUES = (
    *(
        None,
        True,
        -1,
        0,
        1,
        2,
        3,
        2**31,
        2**63,
        10**30,
        1e308,
        float("nan"),
        0.5,
        "",
        "x",
        [],
        {},
        [0],
        [[0]],
        [1e200] * 4,
    ),
    *("SCALAR", "VEC3", "MAT4", "STEP", "CUBICSPLINE", "weights", "rotation", {"a": 0}, 5120, 5121, 5125, 5126),
)
"""Values that readers of JSON often handle wrongly; the second row has those that glTF knows."""


class Edit(NamedTuple):
    """One change."""

    kind: Kind
    where: float
    """Place, from 0 (the first byte) to 1 (the end)."""
    length: int
    """Bytes that are dropped or repeated, or the bit that is flipped."""
    word: bytes
    """What is put in place of up to seven bytes."""


def apply_edits(data: bytes, edits: Iterable[Edit]) -> bytes:
    """`data` after the edits, in their order."""
    made = bytearray(data)
    for edit in edits:
        at = int(edit.where * len(made))
        match edit.kind:
            case "flip":
                made[at : at + 1] = bytes(byte ^ (1 << edit.length % 8) for byte in made[at : at + 1])
            case "put":
                made[at : at + edit.length % 8] = edit.word
            case "drop":
                del made[at : at + edit.length]
            case "again":
                made[at:at] = made[at : at + edit.length]
            case "cut":
                del made[at:]
    return bytes(made)


def edit_values(document: Any, data: bytes) -> None:
    """Changes values anywhere in a JSON document, each as two bytes of `data` choose the place and one the change."""
    for start in range(0, len(data) - 2, 3):
        places = list(_list_places(document))
        if not places:
            return
        holder, key = places[int.from_bytes(data[start : start + 2], "big") % len(places)]
        change = data[start + 2]
        if change < len(VALUES):
            holder[key] = copy.deepcopy(VALUES[change])
        elif change < 2 * len(VALUES) or not isinstance(holder[key], int | float):
            holder.pop(key)
        else:
            holder[key] += change - 160


def _list_places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Each object or array in the document, with each of its keys or indices."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in list(entries):
        yield value, key
        yield from _list_places(inner)


def mutate(data: bytes, rng: random.Random, most: int = 4) -> bytes:
    """`data` after up to `most` random edits."""
    return apply_edits(
        data,
        (
            Edit(rng.choice(KINDS), rng.random(), rng.randint(1, MOST_BYTES), rng.choice(WORDS))
            for _ in range(rng.randint(1, most))
        ),
    )
