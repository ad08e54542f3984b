import io

import numpy as np
import pytest

import ciir
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.pictures import decode
from ciir.renderer.view_order.evidence import ORDERS
from ciir.renderer.writers.pictures import encode
from ciir.service.cli.main import main
from ciir.service.pipeline.options import RECONSTRUCTION
from ciir.service.pipeline.options.writing import WRITING
from ciir.service.pipeline.typed_options import ReconstructionOptions
from tests.support.inputs import EIA, EIA_PNG, make_picture
from tests.support.light_fields import make_views, put_in, wind, write_views

SMALL = {"lenses": (12, 10), "pixels": (3, 4), "backend": "raytrace"}


class Counts(list):
    def __call__(self, done, total):
        self.append((done, total))


def test_rendered_views_are_those_of_the_main_job():
    light_field = ciir.render("scene:vase", **SMALL)
    assert light_field.views.shape == (3, 4, 12, 10, 3)
    result = ciir.reconstruct("scene:vase", views="all", model="none", **SMALL)
    for (v, u), picture in result.views.items():
        np.testing.assert_array_equal(light_field.view(v, u), picture)


def test_open_reads_an_elemental_image_array(tmp_path):
    (tmp_path / "eia.png").write_bytes(EIA_PNG)
    light_field = ciir.open(tmp_path / "eia.png", lenses=(6, 9))
    np.testing.assert_array_equal(light_field.eia(), EIA)
    np.testing.assert_array_equal(light_field.view(1, 2), EIA[1::4, 2::4])


@pytest.mark.parametrize("model", ["fast", "bicubic"])
def test_upscaled_views_are_those_of_the_command(tmp_path, model):
    views = np.stack([make_picture(6, 9, seed=seed) for seed in range(6)]).reshape(2, 3, 6, 9, 3)
    light_field = ciir.LightField(views, pixel_aspect=1.5)
    large = ciir.upscale(light_field, model=model)
    assert large.pixel_aspect == 1.5
    light_field.save(tmp_path / "eia.png")
    result = ciir.reconstruct(tmp_path / "eia.png", pixels=(2, 3), views="all", model=model)
    assert large.views.shape == (2, 3, 12, 18, 3)
    for (v, u), picture in result.views.items():
        np.testing.assert_array_equal(large.view(v, u), picture)


def test_the_types_name_every_option():
    assert [*ReconstructionOptions.__annotations__] == [name for name in RECONSTRUCTION if name not in WRITING]


def test_fusion_is_that_of_the_command():
    random = np.random.default_rng(0)
    views = random.integers(0, 256, (5, 5, 9, 10, 3)).astype(np.uint8)
    light_field = ciir.LightField(views, is_ordered=True, is_jpeg=True)
    for fusion in ("auto", "always", "never"):
        large = ciir.upscale(light_field, model="field", fusion=fusion)
        result = ciir.reconstruct(light_field, model="field", fusion=fusion)
        np.testing.assert_array_equal(large.view(2, 2), result.views[2, 2])
        is_fused = any(reason.startswith("fusion: 1 of 1") for reason in result.report["plan"]["reasons"])
        assert is_fused == (fusion != "never")
        assert not large.is_jpeg


@pytest.mark.parametrize("shape", [(8, 9), (8, 9, 1), (8, 9, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_one_picture_keeps_its_shape_and_type(shape, dtype):
    picture = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype)
    large = ciir.upscale(picture, model="nearest")
    assert large.dtype == dtype
    np.testing.assert_array_equal(large, picture.repeat(2, 0).repeat(2, 1))


@pytest.mark.parametrize(("name", "shape"), [("a.png", (8, 9)), ("b.tif", (8, 9, 4)), ("c.jpg", (8, 9, 3))])
def test_a_picture_by_its_path(tmp_path, name, shape):
    """Its pixels are those of `ciir upscale`."""
    path = tmp_path / name
    path.write_bytes(encode(np.random.default_rng(0).integers(0, 255, (*shape, 1)[:3], np.uint8), path.suffix))
    large = ciir.upscale(str(path))
    assert large.shape == (16, 18, *shape[2:])
    assert main(["upscale", str(path), "-o", str(tmp_path / "large.png")]) == 0
    expected = decode((tmp_path / "large.png").read_bytes(), name="large.png")
    np.testing.assert_array_equal(large.reshape(expected.shape), expected)
    np.testing.assert_array_equal(ciir.upscale(path), large)


def test_progress_counts_to_the_end():
    light_field = ciir.render("scene:vase", progress=(rendered := Counts()), **SMALL)
    ciir.upscale(light_field, model="bicubic", progress=(upscaled := Counts()))
    assert rendered == [(number, 12) for number in range(1, 13)]
    assert (upscaled[0], upscaled[-1]) == ((0, 12), (12, 12))


@pytest.mark.parametrize("name", ["one.png", "one.tif", "views.zip", "views"])
def test_a_result_is_saved(tmp_path, name):
    result = ciir.reconstruct("scene:vase", views="center" if "one" in name else "all", model="bicubic", **SMALL)
    result.save(tmp_path / name)
    if "one" in name:
        saved = decode((tmp_path / name).read_bytes(), name=name)
        np.testing.assert_array_equal(saved, result.views[1, 2])
    else:
        saved = inputs.read(Bundle.from_path(tmp_path / name))
        assert all(np.array_equal(saved.view(v, u), picture) for (v, u), picture in result.views.items())


def test_levels_of_10_bits_fill_the_range_in_jupyter():
    """By the brightest view, not by the one that is shown."""
    views = np.full((3, 3, 8, 8, 1), 100, np.uint16)
    views[0, 0] = 1000
    light_field = ciir.LightField(views)
    result = ciir.reconstruct(light_field, model="none", views="all")
    assert {decode(light_field._repr_png_(), name="x").max(), light_field.view(1, 1).max()} == {6400, 100}
    assert decode(result._repr_png_(), name="x").max() == 64000


def test_pictures_show_in_jupyter():
    result = ciir.reconstruct("scene:vase", model="none", **SMALL)
    shown = decode(result._repr_png_(), name="x")
    np.testing.assert_array_equal(shown, result.views[1, 2])
    np.testing.assert_array_equal(decode(ciir.render("scene:vase", **SMALL)._repr_png_(), name="x"), shown)


@pytest.mark.parametrize(
    "options",
    [
        {"lenses": "12x10", "pixels": [3, 4], "views": [(0, 0), (2, 3)], "background": "ffffff", "skip": False},
        {
            "lenses": np.array([12, 10]),
            "pixels": (3, 4),
            "views": "0,0;2,3",
            "background": (255, 255, 255),
            "pitch": None,
            "skip": np.True_,
            "zoom": np.float32(1),
        },
    ],
)
def test_options_are_taken_in_the_usual_forms(options):
    result = ciir.reconstruct("scene:vase", model="none", backend="raytrace", **options)
    assert list(result.views) == [(0, 0), (2, 3)]
    assert (result.views[0, 0][0, 0] == 255).all()
    assert repr(result) == "Reconstruction(2 views of 12x10 pixels, model none)"


@pytest.mark.parametrize(
    "options",
    [
        {"lenses": 50},
        {"lenses": (50.0, 50.0)},
        {"lenses": (50, 50, 3)},
        {"views": 3},
        {"views": [(0, -1)]},
        {"background": (999, 0, 0)},
        {"scale": 2.5},
        {"model": 1},
        {"skip": 2},
        {"delta": "wide"},
        {"rotate": (1, 2, 1000)},
        {"lenses": (-1, 10)},
        {"skip": np.float32(0.5)},
        {"lens_pitch": 3},
    ],
)
def test_options_of_a_wrong_type_are_one_line(options):
    (name,) = options
    with pytest.raises(ciir.InvalidOption, match=f"^{name}: .*; give "):
        ciir.reconstruct("scene:vase", **options)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda _: ciir.upscale("views.npz"), r"images: views\.npz is not a picture file; give one .* ciir\.open"),
        (lambda folder: ciir.upscale(folder / "gone.png"), r"gone\.png: "),
        (lambda folder: ciir.upscale(""), r"images: '' is not a name"),
        (lambda _: ciir.upscale([[0]]), r"list is not accepted; give a picture"),
        (
            lambda _: ciir.upscale(np.zeros((4, 4))),
            r"images: float64 is not accepted; give .* \(255 \* images\)\.round",
        ),
        (lambda _: ciir.upscale(np.full((4, 4), 9.0)), r"images: float64 .* as in images\.round\(\)"),
        (lambda _: ciir.upscale(np.zeros((4, 4, 5), np.uint8)), r"images: an array of shape \(4, 4, 5\) .* 1 to 4"),
        (lambda _: ciir.upscale(np.zeros((1, 1, 4, 4, 3), np.uint8)), r"ciir\.LightField"),
        (lambda _: ciir.LightField(np.zeros((4, 4, 3), np.uint8)), r"\(V, U, H, W, C\)"),
        (lambda folder: ciir.open(folder / "cube.off"), r"ciir\.render"),
        (lambda _: ciir.open("scene:vase"), r"ciir\.render"),
        (lambda folder: ciir.render(folder / "eia.png"), "holds pictures"),
        (lambda _: ciir.reconstruct("scene:vase", lense=1), "'lense': no such option; the options are lenses"),
        (lambda _: ciir.reconstruct("scene:vase", fps=3), "'fps': no such option; the options are lenses"),
        (lambda _: ciir.reconstruct("scene:vase", lens_pitch=3), "lens_pitch: 3 is out of range; give 5 to 200"),
        (lambda _: ciir.reconstruct("scene:vase", lenses=(0, -1)), "give rows and columns from 1 to 999,999, such as"),
        (lambda _: ciir.open("scene:vase", white=3), "white: 3 is not a name"),
        (lambda _: ciir.open([EIA]), "a path, a file, bytes or a NumPy array is needed, not list"),
        (lambda _: ciir.open(EIA), "^array.npy: .* in lenses 50x50"),
        (lambda _: ciir.open(np.array([None])), "array.npy: an array of Python objects; give numbers"),
        (lambda _: ciir.open(EIA, lens_pitch=9, white=EIA / 255), r"white: float64 .*\(255 \* white\)\.round"),
        (lambda _: ciir.upscale(EIA, model="field"), "field takes the views of a light field"),
        (lambda _: ciir.upscale(np.zeros((0, 5, 3), np.uint8)), r"images: an array of shape \(0, 5, 3\)"),
        (lambda _: ciir.render("scene:vase", **SMALL).eia(pickup="turned"), "pickup: 'turned'"),
        (lambda _: ciir.open(EIA_PNG), "bytes: .*lenses"),
        (lambda _: ciir.open(b"GIF"), "bytes: text of no known format"),
        (lambda _: ciir.open(io.BytesIO()), r"file: the file is empty"),
        (lambda _: ciir.open(io.StringIO("")), r"read\(\) gives str, not bytes; open it with mode 'rb'"),
        (lambda _: ciir.render("scene:vase", **SMALL).save("/proc/a/b.png"), "name a"),
        (lambda _: ciir.reconstruct("scene:vase", model="none", **SMALL).save("views.bmp"), r"\.bmp can't be written"),
        (lambda _: ciir.render("scene:vase", **SMALL).view(3, 0), "v goes from 0 to 2"),
    ],
)
def test_errors_are_one_line_with_the_remedy(tmp_path, cube_file, eia_file, call, words):
    with pytest.raises(ciir.Error, match=words) as caught:
        call(tmp_path)
    assert "\n" not in str(caught.value)


def test_bytes_open_files_and_arrays_are_read_as_files_are(eia_file, cube_file, tmp_path):
    size = (6, 9)
    expected = ciir.open(eia_file, lenses=size)
    assert np.array_equal(ciir.open(EIA, lenses=size), expected)
    with eia_file.open("rb", buffering=0) as file:
        assert np.array_equal(ciir.open(file, lenses=size), expected)
    assert np.array_equal(ciir.open(EIA_PNG, lenses=size), expected)
    assert np.array_equal(ciir.open(io.BytesIO(EIA_PNG), lenses=size), expected)
    assert np.array_equal(ciir.render(cube_file.read_bytes(), **SMALL), ciir.render(cube_file, **SMALL))
    assert ciir.reconstruct(EIA_PNG, lenses=size, model="none").report["input"]["name"] == "bytes"


def test_open_files_stay_within_the_limit(monkeypatch):
    monkeypatch.setenv("CIIR_MAX_UNPACKED_BYTES", "1000000")
    asked = []

    class Endless:
        name = 3

        def read(self, size):
            asked.append(size)
            return bytes(size)

    with pytest.raises(ciir.TooLarge, match="file: over 1,000,000 bytes"):
        ciir.open(Endless())
    assert asked == [1_000_001]


def test_the_order_of_views_is_checked_where_it_is_not_known(stand_in, tmp_path):
    views = make_views(channels=3)
    (tmp_path / "views").mkdir()
    for name, data in write_views(views, lambda v, u: f"{u}_{v}.png").items():
        (tmp_path / "views" / name).write_bytes(data)
    field = ciir.open(tmp_path / "views")
    assert field.is_ordered
    assert "in 0_4.png 0 is the column and 4 the row" in field.notes[0]
    assert np.array_equal(field.views, views)
    assert np.array_equal(ciir.open(tmp_path / "views", order="given").views, views.transpose(1, 0, 2, 3, 4))
    for content, is_noted in (
        (field, False),
        (ciir.LightField(views[::-1]), True),
        (ciir.LightField(views[::-1], is_ordered=True), False),
    ):
        notes = ciir.reconstruct(content, views="center").report["notes"]
        assert any("seem to be reversed" in note for note in notes) == is_noted
    for order in ("given", "rows", "columns", "serpentine"):
        notes = ciir.reconstruct(ciir.LightField(views[::-1]), order=order).report["notes"]
        assert not any("seem to be reversed" in note for note in notes)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("winds", [False, True])
def test_views_in_a_wrong_order_are_upscaled_as_in_the_right_one(stand_in, order, winds):
    views = make_views((3, 5), channels=3)
    given = put_in(order, views)
    given = wind(given) if winds else given
    right = ciir.reconstruct(ciir.LightField(views), views="all").views
    want = put_in(order, np.reshape(list(right.values()), (3, 5, 192, 192, 3)))
    want = wind(want) if winds else want
    got = ciir.reconstruct(ciir.LightField(given), views="all")
    assert list(got.views) == list(np.ndindex(given.shape[:2]))
    assert all(np.array_equal(picture, want[view]) for view, picture in got.views.items())
    assert any("in the right order" in note for note in got.report["notes"]) == (winds or order != "as given")
