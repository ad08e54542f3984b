import dataclasses
import hashlib
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from ciir import models
from ciir.errors import InvalidOption, UnknownModel, UnsuitedModel, UnsupportedScale
from ciir.models import cards, catalogue
from ciir.models.catalogue import SHIPPED


def test_names_and_entries():
    entries = models.list_entries()
    assert [entry.name for entry in entries] == models.list_names()
    assert catalogue.FALLBACK in models.list_names()
    assert models.list_names()[-2:] == ["bicubic", "nearest"]
    assert all((entry.card is None) == (entry.kind == "interpolation") for entry in entries)


@pytest.mark.parametrize("name", catalogue.list_single_image_names())
def test_each_model_loads(name):
    (entry,) = (entry for entry in models.list_entries() if entry.name == name)
    if entry.unsupported_reason:
        pytest.skip(entry.unsupported_reason)
    upscaler = models.load_upscaler(name, scale=entry.scales[0])
    assert (upscaler.name, upscaler.scale) == (name, entry.scales[0])
    assert models.load_upscaler(name, scale=entry.scales[0]) is upscaler


def copy_network(folder, name):
    """`fast` under another name."""
    folder.mkdir(exist_ok=True)
    shutil.copy(SHIPPED / "fast.onnx", folder / f"{name}.onnx")
    cards.write_card(dataclasses.replace(cards.read_card(SHIPPED / "fast.json"), name=name), folder / f"{name}.json")


def test_networks_of_ones_own(tmp_path, monkeypatch):
    before = models.list_names()
    copy_network(tmp_path / "own", "mine")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CIIR_MODELS", "own")
    assert models.list_names() == [*before[:-2], "mine", "bicubic", "nearest"]
    assert models.load_upscaler("mine").name == "mine"
    monkeypatch.setenv("CIIR_MODELS", "")
    assert models.list_names() == before
    with pytest.raises(UnknownModel, match=r"that `ciir export` wrote, set CIIR_MODELS=own and give mine$"):
        models.load_upscaler("own/mine.json")
    with pytest.raises(UnknownModel, match=r"run `ciir export own/mine.onnx -o DIR` with a folder for CIIR_MODELS$"):
        models.load_upscaler("own/mine.onnx")
    with pytest.raises(UnknownModel, match="no 'mine' here"):  # although it was loaded before
        models.load_upscaler("mine")


@pytest.mark.parametrize(
    ("folder", "message"), [("nothing", "is not a folder"), ("taken", "fast is the name of another")]
)
def test_a_folder_of_ones_own_that_cannot_be_used(tmp_path, monkeypatch, folder, message):
    copy_network(tmp_path / "taken", "fast")
    monkeypatch.setenv("CIIR_MODELS", str(tmp_path / folder))
    with pytest.raises(InvalidOption, match=message):
        models.list_names()


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.onnx")), ids=lambda path: path.stem)
def test_each_shipped_network_has_its_card(path):
    (entry,) = (entry for entry in models.list_entries() if entry.name == path.stem)
    assert entry.card.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    bytes_each = {"float32": 4, "int8": 1}[entry.card.precision]
    assert path.stat().st_size > bytes_each * entry.card.parameters  # the weights are inside


def test_to_add_a_network_its_two_files_are_enough(tmp_path, monkeypatch):
    card = dataclasses.replace(cards.read_card(SHIPPED / "paper.json"), name="mine")
    cards.write_card(card, tmp_path / "mine.json")
    shutil.copy(SHIPPED / "paper.onnx", tmp_path / "mine.onnx")
    monkeypatch.setattr(catalogue, "SHIPPED", tmp_path)
    assert models.list_names() == ["mine", "bicubic", "nearest"]
    assert models.load_upscaler("mine").name == "mine"


def test_int8_networks_name_a_float_twin_and_only_they_can_be_unsupported(monkeypatch):
    monkeypatch.setattr(models.catalogue.processor, "int8_unsupported_reason", lambda: "no VNNI")
    for entry in models.list_entries():
        is_int8 = entry.card is not None and entry.card.precision == "int8"
        assert entry.unsupported_reason == ("no VNNI" if is_int8 else "")
        if is_int8:
            assert entry.card.float_twin in models.list_names()


@pytest.mark.parametrize(
    ("load", "known", "others"),
    [(models.load_upscaler, "paper", "field"), (catalogue.load_light_field_network, "field", "paper")],
)
def test_an_unknown_model(load, known, others):
    with pytest.raises(UnknownModel, match=rf"no 'fancy' here; give one of .*\b{known}\b") as caught:
        load("fancy")
    assert others not in str(caught.value)


@pytest.mark.parametrize(("name", "scale"), [("paper", 3), ("bicubic", 9), ("nearest", 1)])
def test_a_scale_that_a_model_lacks(name, scale):
    with pytest.raises(UnsupportedScale, match="scale"):
        models.load_upscaler(name, scale=scale)


def test_threads_that_load_at_once_share_one_model():
    with ThreadPoolExecutor(8) as pool:
        loaded = list(pool.map(lambda _: models.load_upscaler("paper", threads=1), range(8)))
    assert len({id(upscaler) for upscaler in loaded}) == 1


def test_listing_imports_no_runtime():
    """`ciir models` must answer within a second."""
    heavy = {"onnxruntime", "torch", "PIL", "onnx", "skimage", "scipy"}
    code = f"import sys; from ciir import models; models.list_entries(); print({heavy} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("name", [entry.name for entry in models.list_entries() if entry.is_light_field])
def test_a_light_field_network_is_no_upscaler(name):
    (entry,) = (entry for entry in models.list_entries() if entry.name == name)
    if entry.unsupported_reason:
        pytest.skip(entry.unsupported_reason)
    network = catalogue.load_light_field_network(name)
    assert network.name == name
    assert network is catalogue.load_light_field_network(name)
    with pytest.raises(UnsuitedModel, match=f"model {name}: .* use `ciir reconstruct`, or name quality"):
        models.load_upscaler(name)


def test_an_upscaler_is_no_light_field_network():
    with pytest.raises(UnsuitedModel, match="model fast: it upscales single pictures"):
        catalogue.load_light_field_network("fast")


def test_an_int8_twin_is_the_default_where_the_processor_supports_it(monkeypatch):
    monkeypatch.setattr(catalogue.processor, "int8_unsupported_reason", lambda: "")
    assert (catalogue.picture_default_name(), catalogue.light_field_default_name()) == ("quality-int8", "field-int8")
    assert catalogue.prefer_int8("gan") == "gan"  # it has no twin
    assert catalogue.prefer_int8("bicubic") == "bicubic"
    monkeypatch.setattr(catalogue.processor, "int8_unsupported_reason", lambda: "no VNNI")
    assert (catalogue.picture_default_name(), catalogue.light_field_default_name()) == (
        catalogue.FALLBACK,
        catalogue.LIGHT_FIELD_DEFAULT,
    )
