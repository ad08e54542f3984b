import re
from dataclasses import asdict, fields, replace
from pathlib import Path

import pytest

from ciir.models import catalogue
from ciir.training import recipe as recipes
from ciir.training.recipe import choose_name
from tests.support.paths import ROOT

SHIPPED = sorted((ROOT / "training" / "recipes").glob("*.toml"))
SHIPPED_BEFORE = {"fast": "fast-seventh", "quality": "quality-sixth"}
"""Network -> the run that made it when other recipes started from `models/shipped`."""
SHIPPED_THEN = {"best-third": "quality-eighth", "gan": "fast-eighth"}
"""Recipe -> the run of the network that shipped when it started."""
SMALLEST = 'name = "a"\nnetwork = "lite"\ntrain = "t"\nvalidate = "v"\nsteps = 5\n'


@pytest.fixture
def smallest(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(SMALLEST)
    return recipes.read_recipe(path)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_recipes_read(path):
    recipe = recipes.read_recipe(path)
    assert recipe.name == path.stem
    assert recipe.light_field == (recipe.network == "light_field")


def test_defaults(smallest):
    assert (smallest.scale, smallest.crop, smallest.batch, smallest.options) == (2, 88, 16, {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SMALLEST + "stepz = 3\n", "unknown key 'stepz'; give steps, "),
        (SMALLEST.replace("steps = 5\n", ""), "steps is missing; add it to the recipe, or give --steps"),
        (SMALLEST.replace('network = "lite"\n', ""), "network is missing; add it to the recipe$"),
        (SMALLEST.replace('"a"', '"my net"'), "name: 'my net': give one of letters"),
        ("steps = ", "a.toml"),
        (SMALLEST.replace("steps = 5", 'steps = "x"'), "steps is 'x'; give a whole number"),
        (SMALLEST.replace("steps = 5", "steps = true"), "steps is True"),
        (SMALLEST + "learning_rate = []\n", "learning_rate is"),
        (SMALLEST + "options = 3\n", "options is 3; give a table"),
        (SMALLEST.replace("steps = 5", "steps = 0"), "steps is 0; give 1 or more"),
        (SMALLEST + "validate_every = 0\n", "validate_every is 0"),
        (SMALLEST + "batch = -1\n", "batch is -1"),
        (SMALLEST + "minutes = -1\n", "minutes is -1; give a finite number of 0 or more"),
        (SMALLEST + "noise = -0.5\n", "noise is -0.5; give a finite number of 0 or more"),
        (SMALLEST + "clip = nan\n", "clip is nan"),
        (SMALLEST + "learning_rate = 0\n", "learning_rate is 0; give a finite number over 0"),
        (SMALLEST + "learning_rate = inf\n", "learning_rate is inf; give a finite number over 0"),
        (SMALLEST + "ema = 1.0\n", "ema is 1.0; give 0 or more and less than 1"),
        (SMALLEST + "jpeg = 101\n", "jpeg is 101"),
        (SMALLEST + "runs = 2\n", "runs is 2; give 1, or 2 for a light-field network"),
        (SMALLEST + "light_field = true\nruns = 3\n", "runs is 3; give 1, or 2"),
        (SMALLEST + "corrupted = 1.5\n", "corrupted is 1.5; give a share of 0 to 1"),
        (SMALLEST + "corrupted = -0.1\n", "corrupted is -0.1; give a share of 0 to 1"),
        (SMALLEST + 'device = "tpu"\n', "device is 'tpu'; give one of auto, cpu, cuda"),
    ],
)
def test_a_bad_recipe_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        recipes.read_recipe(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_given_fields_replace_or_fill_those_of_the_file(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(SMALLEST.replace('train = "t"\n', ""))
    read = recipes.read_recipe(path, {"train": "here", "steps": 7})
    assert (read.train, read.steps, read.validate) == ("here", 7, "v")
    with pytest.raises(ValueError, match="train is missing"):
        recipes.read_recipe(path, {"steps": 7})


def test_the_field_in_which_recipes_differ(smallest):
    saved = asdict(smallest)
    assert recipes.find_difference(saved, smallest) == ""
    assert recipes.find_difference(saved, replace(smallest, steps=9)) == "steps is 5 there and 9 here"
    assert recipes.find_difference(saved, replace(smallest, options={"blocks": 3})).startswith("options is {} there")
    assert recipes.find_difference(saved | {"stride": 3}, smallest) == "stride is 3 there and None here"


@pytest.mark.parametrize("name", sorted(recipes.CHANGEABLE))
def test_fields_that_may_differ(smallest, name):
    assert recipes.find_difference(asdict(smallest) | {name: "other"}, smallest) == ""


def test_a_field_that_came_later_counts_as_its_default(smallest):
    old = {name: value for name, value in asdict(smallest).items() if name not in {"loss", "meshes", "degradations"}}
    assert recipes.find_difference(old, smallest) == ""
    assert recipes.find_difference(old, replace(smallest, loss="mse")) == "loss is 'l1' there and 'mse' here"


@pytest.mark.parametrize("name", [field.name for field in fields(recipes.Recipe)])
def test_every_field_is_documented(name):
    text = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
    table = text[text.index("### Fields") : text.index("### Watch")]
    assert any(f"`{name}`" in line.split("|")[1] for line in table.splitlines() if line.startswith("| `"))


def test_paths_on_cards_are_short():
    given = {"name": "a", "train": "/home/me/VOC2012", "validate": "../set", "initial": "/home/me/runs/a/checkpoint.pt"}
    given |= {"vgg": "", "meshes": ["/b.obj", "c/d/e.obj"], "averaged": ["runs/x/checkpoint.pt"], "steps": 3}
    assert recipes.shorten_paths(given) == given | {
        "train": "VOC2012",
        "validate": "set",
        "initial": "a/checkpoint.pt",
        "meshes": ["b.obj", "d/e.obj"],
        "averaged": ["x/checkpoint.pt"],
    }


def list_runs(folder):
    """The recipes whose runs a checkpoint's folder comes from: one, or those whose mean a recipe's comment makes."""
    comments = " ".join(path.read_text(encoding="utf-8") for path in SHIPPED).replace("\\\n#", " ")
    means = {
        out: re.findall(r"runs/([\w-]+)/", checkpoints)
        for checkpoints, out in re.findall(r"training\.export\.average (.*?) -o runs/([\w-]+)/", comments)
    }
    return [run for name in means[folder] for run in list_runs(name)] if folder in means else [folder]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_recipe_starts_from_shipped_ones(path):
    """Of the same network: no weight shows a slope, a guard or rounding, so these may change; layers may be added.

    A light-field network may start from the single-picture network that it contains.
    """
    this = recipes.read_recipe(path)
    initial = Path(this.initial)
    folder = initial.parent.name
    if initial.parent == Path("models/shipped"):
        folder = SHIPPED_THEN.get(path.stem) or SHIPPED_BEFORE[initial.stem]
    for run in list_runs(folder) if this.initial else []:
        before = recipes.read_recipe(path.with_name(f"{run}.toml"))
        if this.light_field > before.light_field:
            pytest.importorskip("torch", reason="needs the training extra")
            from ciir.training.networks import make_network

            held, alone = (
                {name: weight.shape for name, weight in network.state_dict().items()}
                for network in (
                    make_network(this.network, this.options).single,
                    make_network(before.network, before.options),
                )
            )
            assert alone.items() <= held.items()
            assert held == alone or initial.suffix == ".onnx"
            continue
        assert before.scale == this.scale
        assert before.network == {"ensemble": "compact"}.get(this.network, this.network)  # an ensemble is of those
        without_weights = {"slope", "guard", "rounded", "projected"}
        ours, theirs = ({k: v for k, v in one.options.items() if k not in without_weights} for one in (this, before))
        if initial.suffix == ".onnx":
            ours["widths"] = ours["widths"][: len(theirs["widths"])]
        assert ours == theirs


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("fast", "fast-shipped-eighth"),
        ("quality", "quality-eighth"),
        ("best", "best-third"),
        ("gan", "gan"),
        ("field", "field-eighth"),
        ("field-quality", "field-quality-first"),
    ],
)
def test_what_ships_is_what_its_recipe_makes(name, folder):
    (card,) = (entry.card for entry in catalogue.list_entries() if entry.name == name)
    recipe = card.training.recipe
    averaged = recipe.get("averaged", [f"runs/{recipe['name']}/checkpoint.pt"])
    assert sorted(list_runs(folder)) == sorted(run for path in averaged for run in list_runs(Path(path).parent.name))


@pytest.mark.parametrize("own", ["fast", "bicubic"])
def test_an_exported_network_has_no_shipped_name_by_accident(own):
    with pytest.raises(ValueError, match=f"'{own}' is the name of a model that ships; .* --name my-{own}"):
        choose_name("", own)
    assert choose_name(own, "mine") == choose_name(own, own) == own
    assert choose_name("", "mine") == "mine"
