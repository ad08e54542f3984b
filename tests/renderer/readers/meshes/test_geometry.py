import numpy as np

from ciir.renderer.readers.meshes.geometry import normalise, note_hollow_polygons, triangulate_fans


def test_fans_keep_order_and_source() -> None:
    corners = np.array([4, 5, 6, 7, 1, 2, 1, 2, 3, 0, 1, 2, 3, 4])
    faces, source = triangulate_fans(np.array([4, 2, 3, 5]))
    assert corners[faces].tolist() == [[4, 5, 6], [4, 6, 7], [1, 2, 3], [0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert source.tolist() == [0, 0, 2, 3, 3, 3]


def find_notes(lengths: list[int], vertices: list[list[float]]) -> list[str]:
    notes: list[str] = []
    note_hollow_polygons(np.array(vertices), *triangulate_fans(np.array(lengths)), notes.append)
    return notes


def test_polygons_whose_fans_reach_out_of_them_are_noted() -> None:
    square = [[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
    bent = [[0.0, 0, 0], [4, 0, 1], [4, 4, 0], [0, 4, 1]]
    arrow = [[0.0, 0, 0], [1, 1, 0], [4, 0, 0], [0, 4, 0]]  # its fan fits in from the last corner
    letter = [[0.0, 0, 0], [4, 0, 0], [4, 1, 0], [1, 1, 0], [1, 3, 0], [4, 3, 0], [4, 4, 0], [0, 4, 0]]
    assert find_notes([4, 3, 4, 4, 2], square + square[:3] + bent + arrow[::-1] + square[:2]) == []
    assert find_notes([4, 3, 4, 8], square + square[:3] + arrow + letter) == [
        "2 polygons are not convex and may be drawn beyond their outlines; triangulate the mesh and export it again"
    ]


def test_normalised() -> None:
    assert normalise(np.array([0, 255], np.uint8)).tolist() == [0, 1]
    assert normalise(np.array([-32768, -32767, 32767], np.int16)).tolist() == [-1, -1, 1]
    assert normalise(np.array([0.5, 3.0])).tolist() == [0.5, 3.0]
