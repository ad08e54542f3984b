import time

import numpy as np
import pytest
from numpy.typing import NDArray

from ciir.renderer.readers.meshes import polygons
from ciir.renderer.readers.meshes.polygons import triangulate, triangulate_fans

SQUARE = [[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
BENT = [[0.0, 0, 0], [4, 0, 1], [4, 4, 0], [0, 4, 1]]
ARROW = [[0.0, 0, 0], [1, 1, 0], [4, 0, 0], [0, 4, 0]]
LETTER = [[0.0, 0, 0], [4, 0, 0], [4, 1, 0], [1, 1, 0], [1, 3, 0], [4, 3, 0], [4, 4, 0], [0, 4, 0]]
WITH_HOLE = [*SQUARE, SQUARE[0], [1, 1, 0], [1, 3, 0], [3, 3, 0], [3, 1, 0], [1, 1, 0]]
REPEATED = [*LETTER[:3], LETTER[2], *LETTER[3:5], LETTER[4], *LETTER[5:]]
CROSSED = [[0.0, 0, 0], [4, 4, 0], [4, 0, 0], [0, 5, 0]]


def test_fans_keep_order_and_source() -> None:
    corners = np.array([4, 5, 6, 7, 1, 2, 1, 2, 3, 0, 1, 2, 3, 4])
    faces, source = triangulate_fans(np.array([4, 2, 3, 5]))
    assert corners[faces].tolist() == [[4, 5, 6], [4, 6, 7], [1, 2, 3], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert source.tolist() == [0, 0, 2, 3, 3, 3]


def find_areas(corners: list[list[float]], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Twice the area of each triangle as a vector."""
    first, second, third = (np.array(corners)[triangles[:, corner]] for corner in range(3))
    return np.cross(second - first, third - first)


@pytest.mark.parametrize(
    "polygon", [ARROW, LETTER, WITH_HOLE, REPEATED], ids=["arrow", "letter", "with a hole", "repeated corners"]
)
@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("axes", [[0, 1, 2], [1, 0, 2], [2, 0, 1], [0, 2, 1]], ids=str)
def test_triangles_fill_a_polygon_from_any_corner_on_any_side(
    polygon: list[list[float]], first: int, axes: list[int]
) -> None:
    corners = np.roll(np.array(polygon)[:, axes], -first, axis=0).tolist()
    notes: list[str] = []
    triangles, source = triangulate(np.array(corners), np.arange(len(corners)), np.array([len(corners)]), notes.append)
    areas = find_areas(corners, triangles)
    whole = areas.sum(axis=0)
    assert (len(triangles), notes, set(source)) == (len(corners) - 2, [], {0})
    assert (areas @ whole >= 0).all()
    # Without an overlap what faces one way sums up to the area, as it would with triangles on both sides.
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(np.linalg.norm(whole))


def test_polygons_whose_fans_fit_stay_fans() -> None:
    fitting = SQUARE + SQUARE[:3] + BENT + ARROW[::-1] + SQUARE[:2]
    lengths = np.array([4, 3, 4, 4, 2])
    triangles, _ = triangulate(np.array(fitting), np.arange(len(fitting)), lengths, pytest.fail)
    assert triangles.tolist() == triangulate_fans(lengths)[0].tolist()


def test_what_can_not_be_cut_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    def find_notes() -> list[str]:
        notes: list[str] = []
        corners = SQUARE + CROSSED + LETTER
        triangles, _ = triangulate(np.array(corners), np.arange(len(corners)), np.array([4, 4, 8]), notes.append)
        assert len(triangles) == 10
        return notes

    noted = " polygons cross themselves, or are not convex and have too many corners: they may be drawn beyond their "
    noted += "outlines; triangulate the mesh and export it again"
    assert find_notes() == ["1" + noted]
    monkeypatch.setattr(polygons, "MOST_WORK", 0)
    assert find_notes() == ["2" + noted]


def test_a_polygon_that_is_too_long_to_be_cut_leaves_the_work_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polygons, "MOST_WORK", 100)
    notes: list[str] = []
    corners = LETTER + ARROW
    triangles, _ = triangulate(np.array(corners), np.arange(len(corners)), np.array([8, 4]), notes.append)
    assert triangles[6:].tolist() != (triangulate_fans(np.array([8, 4]))[0][6:]).tolist()
    assert [note[:10] for note in notes] == ["1 polygons"]


def test_a_polygon_of_many_corners_takes_time_by_their_number() -> None:
    angles = np.linspace(0, 2 * np.pi, 600_000, endpoint=False)
    corners = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    corners[len(corners) // 4] = 0, -0.5, 0  # a notch
    begun = time.process_time()
    triangulate(corners, np.arange(len(corners)), np.array([len(corners)]), pytest.fail)
    assert time.process_time() - begun < 6  # with a list that every ear shifts it took 11 s
