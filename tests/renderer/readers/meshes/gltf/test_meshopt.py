import imagecodecs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ciir.errors import TooLarge, Unreadable
from ciir.renderer.readers.meshes.gltf import document, meshopt
from tests.support.meshes.gltf import INDICES, SQUARE, UV, Model

# A grid of 4x4 squares, ten triangles of random corners, and the grid again, by meshoptimizer 1.3's own encoder.
TRIANGLES = bytes.fromhex(
    "e1fe0dfe13fe12fe12fe0dfe03fe02fe02ff0dff03ff02ff02ff0dff03ff02ff02ffffffffffffffffffffff0dff04ff03fe22ff00ff03ff02ff"
    "02fe1dfe13fe12fe12fe0dfe03fe02fe020f0cf304f202f2028f048f048f028f028f070c8f070c8f090c8f090c8f070c8f070c8f090c8f090cff"
    "ca021ec401ef9c018505ffa00464af04ff32be03e302ff77bc03c903ff7abc014bfff1022d9e05ff5944ef01ffe001870364ff8c0293049001ff"
    "f101020aff07020aff09020a2f07af020c9f090c8f090c9f090cf704f304f202f2028f048f048f028f02007687566778a9866589689801690000"
)
FIRST_INDICES = bytes.fromhex(  # the first 60 indices of the same
    "d10004141618020e04141618020e04141618020e04141618020a04141618020e04141618020e04141618020e04141618020a0414161802"
    "0e041416180200000000"
)
_CORNERS = np.arange(25).reshape(5, 5)
_SQUARES = _CORNERS[:-1, :-1], _CORNERS[:-1, 1:], _CORNERS[1:, 1:], _CORNERS[1:, :-1]
GRID = np.stack([_SQUARES[i] for i in (0, 1, 2, 0, 2, 3)], axis=-1).reshape(-1, 3)


def first_corner_least(triangles: np.ndarray) -> list[tuple[int, ...]]:
    """The codec keeps the order of triangles and their winding, but not which corner is first."""
    return [tuple(np.roll(corners, -corners.argmin())) for corners in triangles.reshape(-1, 3)]


def test_triangles_of_the_reference_encoder() -> None:
    found = meshopt.decode_triangles(TRIANGLES, 222).reshape(-1, 3)
    assert first_corner_least(found[:32]) == first_corner_least(GRID)
    assert first_corner_least(found[-32:]) == first_corner_least(GRID)


def test_indices_of_the_reference_encoder() -> None:
    assert meshopt.decode_indices(FIRST_INDICES, 60).tolist() == GRID.ravel()[:60].tolist()


def decode_triangles_slowly(data: bytes, count: int) -> list[int]:
    """Appendix A, mode 1, read aloud: rings are lists with the newest entry first."""
    codes, rest, table = data[1 : 1 + count // 3], list(data[1 + count // 3 : -16]), data[-16:]
    edges: list[tuple[int, int]] = [(2**32 - 1, 2**32 - 1)] * 16
    vertices = [2**32 - 1] * 16
    found, following, last = [], 0, 0

    def decode_index() -> int:
        nonlocal last
        value = shift = 0
        while True:
            byte = rest.pop(0)
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
            if shift == 35:
                raise ValueError
        last = (last + (~(value >> 1) if value & 1 else value >> 1)) % 2**32
        return last

    for code in codes:
        x, y = divmod(code, 16)
        pushed = []
        if x < 15:
            a, b = edges[x]
            if y == 0:
                c, following, pushed = following, following + 1, [following]
            elif y < 13:
                c = vertices[y]
            else:
                c = decode_index() if y == 15 else (last + (-1 if y == 13 else 1)) % 2**32
                last, pushed = c, [c]
            edges = [(a, c), (c, b), *edges][:16]
        else:
            zw = table[y] if y < 14 else rest.pop(0)
            if y >= 14 and zw == 0:
                following = 0
            z, w = divmod(zw, 16)
            corners = []
            for nibble in (15 if y == 15 else 0, z, w):
                if nibble == 0:
                    corners.append(following)
                    following += 1
                else:
                    corners.append(decode_index() if nibble == 15 else vertices[nibble - 1])
                if nibble in (0, 15):
                    pushed.append(corners[-1])
            a, b, c = corners
            edges = [(a, c), (c, b), (b, a), *edges][:16]
        for corner in pushed:
            vertices = [corner, *vertices][:16]
        found += [a, b, c]
    return found


@settings(max_examples=300)
@given(st.binary(min_size=1, max_size=40), st.binary(max_size=60), st.binary(min_size=16, max_size=16))
def test_any_stream_of_triangles_as_the_slow_reference_reads_it(codes: bytes, rest: bytes, table: bytes) -> None:
    data, count = b"\xe1" + codes + rest + table, 3 * len(codes)
    try:
        expected = decode_triangles_slowly(data, count)
    except (IndexError, ValueError):
        with pytest.raises((RuntimeError, StopIteration, ValueError)):
            meshopt.decode_triangles(data, count)
        return
    assert meshopt.decode_triangles(data, count).tolist() == expected


def encode_indices(values: list[int], sequences: list[int]) -> bytes:
    """Appendix A, mode 2."""
    made, last = [0xD1], [0, 0]
    for value, sequence in zip(values, sequences, strict=True):
        step = value - last[sequence]
        last[sequence] = value
        number = (step << 1 if step >= 0 else ~(step << 1)) << 1 | sequence
        while number >= 128:
            made.append(number & 127 | 128)
            number >>= 7
        made.append(number)
    return bytes(made) + bytes(4)


@given(st.lists(st.tuples(st.integers(0, 2**29), st.integers(0, 1)), max_size=50))
def test_indices_of_two_sequences(pairs: list[tuple[int, int]]) -> None:
    values, sequences = [value for value, _ in pairs], [sequence for _, sequence in pairs]
    assert meshopt.decode_indices(encode_indices(values, sequences), len(values)).tolist() == values


# What meshoptimizer's encoder of filters made of these values: 12 bits in 16 of unit vectors and quaternions, 15 bits
# of mantissa, 8 bits of colours.
VECTORS = [[0, 0, 1, 1], [0.6, 0, -0.8, 1], [-0.48, 0.6, 0.64, -1], [0, -1, 0, 1]]
OCTAHEDRAL = [[0, 0, 2047, 32767], [2047, 1170, 2047, 32767], [-571, 714, 2047, -32767], [0, -2047, 2047, 32767]]
ROTATIONS = [[0, 0, 0, 1], [0.5, 0.5, 0.5, 0.5], [0.6, 0, -0.8, 0], [-0.1, 0.7, 0.1, 0.7]]
QUATERNION = [[0, 0, 0, 2047], [1447, 1447, 1447, 2044], [0, -1737, 0, 2046], [289, 2026, -289, 2045]]
FLOATS = [[0, 1.5, -100], [1e-3, 7, 3e5]]
EXPONENTIAL = [[-234881024, -218091520, -100676096], [-385867579, -184535040, 83895455]]
COLORS = [[1, 0, 0, 1], [0.25, 0.5, 0.75, 0.5], [0, 0, 0, 0], [1, 1, 1, 1]]
COLOR = [[64, 127, 193, 255], [128, 193, 0, 192], [0, 0, 0, 128], [255, 0, 0, 255]]


def unpack(values: np.ndarray, filter_: str) -> np.ndarray:
    stored = values.view(np.uint8).reshape(len(values), -1)
    return meshopt.decode(
        imagecodecs.meshopt_encode(stored),
        count=len(stored),
        stride=stored.shape[1],
        mode="ATTRIBUTES",
        filter_=filter_,
    )


def test_octahedral_vectors() -> None:
    found = unpack(np.array(OCTAHEDRAL, "<i2"), "OCTAHEDRAL") / 32767
    assert found == pytest.approx(np.array(VECTORS), abs=2 / 2047)  # a step of 12 bits, which the octahedron stretches
    assert np.linalg.norm(found[:, :3], axis=1) == pytest.approx(1, abs=1e-4)


def test_quaternions() -> None:
    found = unpack(np.array(QUATERNION, "<i2"), "QUATERNION") / 32767
    expected = np.array(ROTATIONS) / np.linalg.norm(ROTATIONS, axis=1, keepdims=True)
    expected[2] *= -1  # the largest component is positive: the same rotation
    assert found == pytest.approx(expected, abs=1 / 2047)


def test_exponents_are_exact() -> None:
    found = unpack(np.array(EXPONENTIAL, "<i4"), "EXPONENTIAL")
    stored = [[(value << 8 & 0xFFFFFFFF, value >> 24) for value in row] for row in EXPONENTIAL]
    exact = [[((m >> 8) - (1 << 24 if m >> 31 else 0)) * 2.0**e for m, e in row] for row in stored]
    assert found.tolist() == exact
    assert found == pytest.approx(np.array(FLOATS), rel=2**-14)


@pytest.mark.parametrize("kind", ["<u1", "<u2"])
def test_colours(kind: str) -> None:
    stored = np.array(COLOR, np.int16)
    stored[:, 1:3] = stored[:, 1:3].astype(np.int8)  # signed: wider integers repeat the sign
    found = unpack(stored.astype(kind), "COLOR")
    assert found.dtype == kind
    assert found / np.iinfo(kind).max == pytest.approx(np.array(COLORS), abs=2 / 255)


def packed_model(name: str, version_filter: str = "NONE") -> Model:
    """The square with each buffer view compressed, and a second buffer in place of what they unpack to."""
    model = Model(TEXCOORD_0=UV).texture()
    for entry, accessor in zip(model.json["bufferViews"], model.json["accessors"], strict=False):
        data = model.binary[entry["byteOffset"] :][: entry["byteLength"]]
        stride = len(data) // accessor["count"]
        packed = (
            encode_indices(INDICES.tolist(), [0, 1] * 3)
            if accessor["type"] == "SCALAR"
            else imagecodecs.meshopt_encode(np.frombuffer(data, np.uint8).reshape(-1, stride))
        )
        source = model.json["bufferViews"][model.view(packed)]
        extension = {**source, "byteStride": stride, "count": accessor["count"], "filter": version_filter}
        extension["mode"] = "INDICES" if accessor["type"] == "SCALAR" else "ATTRIBUTES"
        entry |= {"buffer": 1, "byteOffset": 0, "extensions": {name: extension}}
    model.json["buffers"].append({"byteLength": 1000, "extensions": {name: {"fallback": True}}})
    model.json["extensionsRequired"] = [name]
    return model


@pytest.mark.parametrize("name", meshopt.NAMES)
def test_a_compressed_mesh_is_the_plain_one(name: str) -> None:
    scene, plain = packed_model(name).read(), Model(TEXCOORD_0=UV).texture().read()
    assert np.array_equal(scene.parts[0].vertices, SQUARE)
    for field in ("faces", "colors", "uv"):
        assert np.array_equal(getattr(scene.parts[0], field), getattr(plain.parts[0], field))
    assert scene.notes == ()


def test_what_corrupt_data_and_wrong_names_give() -> None:
    # A stride of 0 ends the process inside meshoptimizer, which also has no room for one over 256.
    strides = [{"byteStride": stride, "count": 1} for stride in (0, -4, 3, 260)]
    for change in ({"mode": "POINTS"}, {"filter": "x"}, {"count": 5}, {"count": 0}, {"byteLength": 7}, *strides):
        model = packed_model(meshopt.NAMES[0])
        model.json["bufferViews"][1]["extensions"][meshopt.NAMES[0]] |= change
        with pytest.raises(Unreadable, match="buffer view 1 has corrupt meshopt data; export it again"):
            model.read()


def test_sizes_are_checked_before_anything_is_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshopt, "decode", None)
    model = packed_model(meshopt.NAMES[0])
    model.json["bufferViews"][1]["extensions"][meshopt.NAMES[0]]["count"] = 10**9
    most = document.ELEMENT_BYTES * document.ELEMENTS * 1000
    with pytest.raises(TooLarge, match=f"unpack to over {most:,} bytes; decimate the mesh"):
        model.read(triangles=1000)


def test_memory_that_runs_out_is_no_corrupt_file(monkeypatch: pytest.MonkeyPatch) -> None:
    def run_out(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(meshopt, "decode", run_out)
    with pytest.raises(TooLarge, match="takes more memory than there is"):
        packed_model(meshopt.NAMES[0]).read()
