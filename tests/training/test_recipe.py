from pathlib import Path

import pytest

from training import recipe as recipes

SHIPPED = sorted((Path(recipes.__file__).parent / "recipes").glob("*.toml"))
SMALLEST = 'name = "a"\nnetwork = "lite"\ntrain = "t"\nvalidate = "v"\nsteps = 5\n'


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_recipes_read(path):
    assert recipes.read(path).name == path.stem


def test_defaults(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(SMALLEST)
    recipe = recipes.read(path)
    assert (recipe.scale, recipe.crop, recipe.batch, recipe.options) == (2, 88, 16, {})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SMALLEST + "stepz = 3\n", "unknown key 'stepz'; known are"),
        (SMALLEST.replace("steps = 5\n", ""), "'steps'"),
        ("steps = ", "a.toml"),
        (SMALLEST.replace("steps = 5", 'steps = "x"'), "steps is 'x'; give a int"),
        (SMALLEST.replace("steps = 5", "steps = true"), "steps is True"),
        (SMALLEST + "learning_rate = []\n", "learning_rate is"),
        (SMALLEST + "options = 3\n", "options is 3; give a table"),
    ],
)
def test_a_bad_recipe_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        recipes.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
