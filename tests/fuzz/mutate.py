"""Edits that make invalid bytes out of valid ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

from tests.fuzz import seeds

if TYPE_CHECKING:
    import random
    from collections.abc import Iterable

Kind = Literal["flip", "put", "drop", "again", "cut"]
KINDS: tuple[Kind, ...] = get_args(Kind)
WORDS = (
    *(b"nan", b"-1", b"1e999", b"9" * 20, b"\0", b"\x1f", b"{}", b"[]", b"null", b"\n", b"\r\n", b" ", b"../", b"%s"),
    *(b"\xff" * 4, b"\x7f", b"/", b"0", b"#", b'"', b";", b"--bound", seeds.BETWEEN, "²é€".encode()),
)
"""Bytes that parsers often handle wrongly."""
MOST_BYTES = 40
"""Of one edit."""


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


def mutate(data: bytes, rng: random.Random, most: int = 4) -> bytes:
    """`data` after up to `most` random edits."""
    return apply_edits(
        data,
        (
            Edit(rng.choice(KINDS), rng.random(), rng.randint(1, MOST_BYTES), rng.choice(WORDS))
            for _ in range(rng.randint(1, most))
        ),
    )
