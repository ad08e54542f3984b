"""Which parts of views are upscaled in one run."""

from ciir.models.light_field.batches import Part, make_batches
from ciir.models.light_field.planes import Range
from ciir.models.tiles import Tile

HERE = (slice(0, 10), slice(0, 12))
WIDE, NARROW = Range(-1.0, 1.0), Range(0.0, 0.5)


def test_parts_of_one_size_window_and_range_share_a_batch():
    wanted = [(3, 3), (3, 4), (0, 3), (4, 3)]
    parts = [Part(number, Tile(HERE, HERE)) for number in range(len(wanted))]
    small = (slice(0, 10), slice(0, 11))
    made = list(make_batches([*parts, Part(0, Tile(small, small))], wanted, (9, 9), [WIDE, WIDE, WIDE, NARROW]))
    assert [[part.number for part in batch.parts] for batch in made] == [[0, 1], [2], [3], [0]]
    assert [batch.disparities for batch in made] == [WIDE, WIDE, NARROW, WIDE]
    assert [batch.rows.present.argmax() for batch in made] == [2, 0, 2, 2]


def test_large_parts_are_batched_in_smaller_numbers(monkeypatch):
    monkeypatch.setattr("ciir.models.light_field.batches.BATCH_PIXELS", 250)
    wanted = [(2, 2)] * 5
    made = make_batches([Part(number, Tile(HERE, HERE)) for number in range(len(wanted))], wanted, (5, 5), [WIDE] * 5)
    assert [len(batch.parts) for batch in made] == [2, 2, 1]
