"""Inputs for batches."""

from ciir.benchmarks.batch.inputs import write_inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read


def test_inputs_are_all_different(tmp_path):
    write_inputs(tmp_path, arrays=2, meshes=2, lenses=8, pixels=3)
    assert len({path.read_bytes() for path in tmp_path.iterdir()}) == 4
    assert read(Bundle.from_path(tmp_path / "mesh_000.glb")).triangles == 20_480
