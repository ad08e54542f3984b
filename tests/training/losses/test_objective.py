from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.losses import perceptual, pixel
from ciir.training.losses.objective import Objective

CPU = torch.device("cpu")


SMALL = {"channels": [4, 8], "normalise": False}
"""A discriminator that costs nothing."""


@pytest.fixture
def gan(recipe):
    return replace(
        recipe, loss="mse", perceptual="discriminator", adversarial="bce", adversarial_weight=0.01, discriminator=SMALL
    )


def pictures(seed):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(2, 3, 24, 24, generator=generator), torch.rand(2, 3, 24, 24, generator=generator)


def test_pixels_alone(recipe):
    minimised = Objective(recipe, CPU)
    output, high = pictures(0)
    terms = minimised.generator(output, high)
    assert set(terms) == {"l1"}
    assert terms["l1"] == pixel.l1(output, high)
    assert minimised.discriminator(output, high, 1e-3) == {}
    assert minimised.state_dict() == {}
    minimised.load_state_dict({})


def test_the_papers_sum(recipe, tmp_path, monkeypatch):
    """MSE + VGG-19 content + 1e-3 adversarial, each by itself, on a stand-in for VGG-19."""
    monkeypatch.setattr(perceptual.VggContent.__init__, "__kwdefaults__", {"bfloat16": False, "layout": (4,)})
    state = {"features.0.weight": torch.rand(4, 3, 3, 3), "features.0.bias": torch.rand(4)}
    torch.save(state, tmp_path / "vgg.pth")
    paper = replace(
        recipe, loss="mse", perceptual="vgg19", vgg=str(tmp_path / "vgg.pth"), adversarial="bce", discriminator=SMALL
    )
    minimised = Objective(paper, CPU)
    output, high = pictures(0)
    terms = minimised.generator(output, high)
    assert list(terms) == ["mse", "vgg19", "adversarial"]
    assert terms["mse"] == pixel.mse(output, high)
    assert terms["vgg19"] == perceptual.VggContent(tmp_path / "vgg.pth", CPU)(output, high)
    assert terms["adversarial"] == 1e-3 * minimised.adversary.judge(output)[0]
    assert set(minimised.state_dict()) == {"network", "optimiser", "watch"}  # not VGG's 80 MB


def test_discriminator_features(gan):
    minimised = Objective(replace(gan, perceptual_weight=3.0), CPU)
    output, high = pictures(0)
    output.requires_grad_()
    terms = minimised.generator(output, high)
    assert list(terms) == ["mse", "discriminator", "adversarial"]
    made, real = (minimised.adversary.network.features(t) for t in (output, high))
    assert terms["discriminator"].item() == pytest.approx(3 * perceptual.feature_matching(made, real).item())
    sum(terms.values()).backward()
    assert output.grad.isfinite().all()
    assert set(minimised.discriminator(output, high, 1e-3)) == {"discriminator_loss", "discriminator_accuracy"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"loss": "l3"}, "loss: 'l3' is not known; give one of l1, mse"),
        (
            {"perceptual": "vgg"},
            "perceptual: 'vgg' is not known; give one of vgg19, discriminator",
        ),
        ({"adversarial": "gan"}, "adversarial: 'gan' is not known; give one of bce, hinge"),
        ({"adversarial": "bce", "discriminator": {"depth": 3}}, "discriminator: it doesn't take {'depth': 3}"),
        ({"perceptual": "discriminator"}, 'set adversarial to "bce" or "hinge"'),
        ({"perceptual": "vgg19"}, "vgg: empty, .*; give torchvision's vgg19-dcbb9e9d.pth"),
        ({"perceptual": "vgg19", "vgg": "nowhere.pth"}, "nowhere.pth: no such file; give torchvision's"),
        ({"perceptual": "vgg19", "vgg": "nowhere.pth", "crop": 8}, "crop: 8 pixels are too few"),
    ],
)
def test_a_bad_recipe_is_refused_in_one_line(recipe, changes, message):
    with pytest.raises(ValueError, match=message) as caught:
        Objective(replace(recipe, **changes), CPU)
    assert "\n" not in str(caught.value)


def test_initial_weights_depend_only_on_the_seed(gan):
    torch.manual_seed(5)
    before = torch.get_rng_state()
    first = Objective(gan, CPU).state_dict()["network"]
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(6)
    second, other = (Objective(r, CPU).state_dict()["network"] for r in (gan, replace(gan, seed=gan.seed + 1)))
    assert all(torch.equal(first[key], second[key]) for key in first)
    assert not torch.equal(first["layers.0.0.weight"], other["layers.0.0.weight"])


def test_resuming_is_bit_exact(gan, tmp_path):
    unbroken, stopped, resumed = (Objective(gan, CPU) for _ in range(3))
    for seed in range(4):
        unbroken.discriminator(*pictures(seed), 1e-3)
        if seed < 2:
            stopped.discriminator(*pictures(seed), 1e-3)
    torch.save(stopped.state_dict(), tmp_path / "state.pt")
    resumed.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    for seed in (2, 3):
        resumed.discriminator(*pictures(seed), 1e-3)
    want, got = (o.generator(*pictures(9)) for o in (unbroken, resumed))
    assert got == want
