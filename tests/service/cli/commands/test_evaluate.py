import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import ciir
from ciir import models
from ciir.models.cards import Accuracy
from ciir.renderer.writers.pictures import encode
from ciir.service.cli.main import main
from ciir.service.cli.messages import format_message
from tests.support.cli import fails
from tests.support.inputs import make_picture
from tests.support.light_fields import make_views, put_in, write_views


def test_evaluate(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    high = np.repeat(np.repeat(make_picture(20, 20), 2, 0), 2, 1)
    (tmp_path / "a_HR.png").write_bytes(encode(high, ".png"))
    (tmp_path / "a_LR.png").write_bytes(encode(high[::2, ::2], ".png"))
    assert main(["evaluate", "nearest", str(tmp_path)]) == 0
    assert "PSNR inf dB, SSIM 1.0000" in capsys.readouterr().out
    assert main(["evaluate", "nearest", str(tmp_path), "--degradation", "box", "--json", str(tmp_path / "s.json")]) == 0
    found = json.loads((tmp_path / "s.json").read_text())
    assert "LR: box, to 8 bits" in found["protocol"]
    assert (found["scores"][0]["count"], found["scores"][0]["psnr"]) == (1, None)
    capsys.readouterr()
    assert "no such folder" in fails(capsys, "evaluate", "nearest", tmp_path / "gone")
    file = tmp_path / "a_HR.png"
    assert f"{file}: a file, but a folder of pictures is needed" in fails(capsys, "evaluate", "nearest", file)
    assert f"give --light-field {file}" in fails(capsys, "evaluate", "nearest", tmp_path, file)
    assert "gpt" in fails(capsys, "evaluate", "gpt", tmp_path)
    assert "_LR.png" in fails(capsys, "evaluate", "nearest", Path(__file__).parent)


def test_evaluate_several_models(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.png").write_bytes(encode(np.full((16, 16, 3), 90, np.uint8), ".png"))
    folders, json_file = [str(tmp_path / name) for name in ("one", "two")], tmp_path / "s.json"
    assert main(["evaluate", "nearest", "bicubic", *folders, "--degradation", "box", "--json", str(json_file)]) == 0
    tries = [(model, f"{name} (box)") for model in ("nearest", "bicubic") for name in ("one", "two")]
    assert [line.partition(": ")[0] for line in capsys.readouterr().out.splitlines()] == [
        f"{model} on {data}" for model, data in tries
    ]
    scores = json.loads(json_file.read_text())["scores"]
    assert [(score["model"], score["data"]) for score in scores] == tries
    assert "give MODELs and FOLDERs" in fails(capsys, "evaluate", "nearest", "bicubic")
    assert "qualty: no such folder" in fails(capsys, "evaluate", "nearest", "qualty", *folders)
    other = fails(capsys, "evaluate", *folders)
    assert f"evaluate: {folders[0]} is no model; to compare results, give --truth INPUT and RESULTs" in other


def test_evaluate_refuses_models(tmp_path, capsys):
    for given in (["evaluate", "nosuch", str(tmp_path)], ["evaluate", "nosuch", "--light-field", str(tmp_path)]):
        assert "evaluate: no model 'nosuch' here; give one of best, " in fails(capsys, *given)
    other = fails(capsys, "evaluate", "fast", "field", str(tmp_path))
    assert f"field upscales views of a light field, not single pictures; give --light-field {tmp_path}" in other


def test_evaluate_names_the_current_folder(tmp_path, capsys, monkeypatch):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    (tmp_path / "a.png").write_bytes(encode(np.full((16, 16, 3), 90, np.uint8), ".png"))
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", "nearest", ".", "--degradation", "box"]) == 0
    assert f"nearest on {tmp_path.name} (box): " in capsys.readouterr().out


def test_evaluate_takes_arguments_around_options(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    (tmp_path / "a.png").write_bytes(encode(np.full((16, 16, 3), 90, np.uint8), ".png"))
    for argv in (
        ["nearest", "--degradation", "box", str(tmp_path)],
        ["--degradation", "box", "nearest", str(tmp_path)],
    ):
        assert main(["evaluate", *argv]) == 0
        assert "PSNR inf dB" in capsys.readouterr().out


def make_light_field():
    """5x5 views of flat 2x2 cells: nearest interpolation inverts their means."""
    small = np.random.default_rng(0).integers(0, 255, (5, 5, 16, 20, 3), np.uint8)
    return ciir.LightField(small.repeat(2, axis=2).repeat(2, axis=3), is_ordered=True, depth_sense="cameras")


@pytest.mark.parametrize("name", ["views", "views.zip", "lf.mat", "lf.npz", "eia.png"])
def test_evaluate_any_light_field(tmp_path, capsys, name):
    """Whatever holds the views, several models have a line each."""
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    file = tmp_path / name
    make_light_field().save(file)
    given = ["--light-field", str(file), "--degradation", "box", *(["--lenses", "32x40"] if "eia" in name else [])]
    assert main(["evaluate", "nearest", "bicubic", *given]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"nearest on {name} 5x5 (box): PSNR inf dB, SSIM 1.0000 on Y over 25 views"
    assert lines[1].startswith(f"bicubic on {name} 5x5 (box): PSNR ")
    assert len(lines) == 2


def test_evaluate_writes_json(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    make_light_field().save(tmp_path / "lf.npz")
    given = ["--light-field", str(tmp_path / "lf.npz"), "--grid", "3x4", "--degradation", "box"]
    assert main(["evaluate", "nearest", "bicubic", *given, "--json", str(tmp_path / "scores.json")]) == 0
    capsys.readouterr()
    found = json.loads((tmp_path / "scores.json").read_text())
    assert "central 3x4" in found["protocol"]
    exact, other = found["scores"]
    assert (exact["model"], exact["psnr"], exact["ssim"]) == ("nearest", None, 1)  # JSON has no infinity
    assert (other["model"], other["data"], other["degradation"]) == ("bicubic", "lf.npz 3x4 (box)", "box")
    assert [(view["v"], view["u"]) for view in other["views"]] == [(v, u) for v in range(3) for u in range(4)]
    assert other["psnr"] == pytest.approx(np.mean([view["psnr"] for view in other["views"]]), abs=1e-4)
    assert other["ssim"] == pytest.approx(np.mean([view["ssim"] for view in other["views"]]), abs=1e-5)


def test_evaluate_a_light_field(tmp_path, capsys, monkeypatch):
    asked = []

    def measure(model, path, *, layout, **options):
        asked.append((model, path, options))
        if options["grid"] == (9, 9):
            raise ValueError("knights: no view (8, 8); give a smaller grid")
        mean = Accuracy("knights 5x5 (bicubic)", 25, 31.234, 0.95, 0.204)
        return SimpleNamespace(mean=mean, views={}, notes=("n",), averaged=7)

    stand_in = SimpleNamespace(measure=measure, load_network=lambda *model: model, describe_protocol=str)
    monkeypatch.setitem(sys.modules, "ciir.training.evaluation.light_fields", stand_in)
    given = ["evaluate", "--light-field", str(tmp_path)]
    protocol = {"grid": (5, 5), "degradation": "bicubic", "jpeg": None, "fusion": "auto", "network_only": False}
    assert main(given) == 0
    printed = capsys.readouterr()
    score = "knights 5x5 (bicubic): PSNR 31.23 dB, SSIM 0.9500 on Y over 25 views"
    assert f"{score}; quality made 20 % of the pixels, and 7 views are means with it\n" in printed.out
    assert printed.err == "ciir: note: n\n"
    assert main([*given, "--grid", "3x7", "--degradation", "point", "quality"]) == 0
    assert main(["evaluate", "quality", *given[1:], "--scale", "4"]) == 0
    capsys.readouterr()
    assert main([*given, "--network-only", "--json", str(tmp_path / "s.json")]) == 0
    assert capsys.readouterr().out.endswith(f"{score}\n")
    (written,) = json.loads((tmp_path / "s.json").read_text())["scores"]
    assert (written["fallback"], written["averaged"], written["network_only"]) == (0.204, 7, True)
    assert asked == [
        ((models.catalogue.LIGHT_FIELD_DEFAULT, 2), tmp_path, protocol),
        (("quality", 2), tmp_path, protocol | {"grid": (3, 7), "degradation": "point"}),
        (("quality", 4), tmp_path, protocol),
        ((models.catalogue.LIGHT_FIELD_DEFAULT, 2), tmp_path, protocol | {"network_only": True}),
    ]
    other = fails(capsys, *given, "--network-only", "--fusion", "always")
    assert "--fusion: --network-only scores views without it; leave one of them out" in other
    assert "--network-only: this goes with --light-field" in fails(capsys, "evaluate", "fast", ".", "--network-only")
    assert "no view (8, 8)" in fails(capsys, *given, "--grid", "9x9")


def test_evaluate_through_a_jpeg_of_the_array(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    make_light_field().save(tmp_path / "lf.npz")
    given = ["evaluate", "nearest", "--light-field", str(tmp_path / "lf.npz"), "--degradation", "box", "--jpeg"]
    for quality, least, most in (("95", 38, 48), ("30", 20, 38)):
        path = tmp_path / f"{quality}.json"
        assert main([*given, quality, "--json", str(path)]) == 0
        (score,) = json.loads(path.read_text())["scores"]
        assert score["data"] == f"lf.npz 5x5 (box, JPEG {quality})"
        assert least < score["psnr"] < most
    capsys.readouterr()
    assert "--jpeg: 101 is out of range; give 1 to 100" in fails(capsys, *given, "101")
    assert "--jpeg: this goes with --light-field" in fails(capsys, "evaluate", "fast", str(tmp_path), "--jpeg", "75")


def test_evaluate_reads_as_asked_and_notes_what_it_found(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    for name, picture in write_views(put_in("transposed", make_views((5, 5), channels=3)), "{}_{}.png".format).items():
        (tmp_path / name).write_bytes(picture)
    given = ["evaluate", "bicubic", "--light-field", str(tmp_path), "--json", str(tmp_path.with_suffix(".json"))]
    assert main(given) == 0
    printed = capsys.readouterr()
    (note,) = json.loads(tmp_path.with_suffix(".json").read_text())["notes"]
    assert printed.err == f"ciir: note: {format_message(note)}\n"
    assert "order: 5x5 views" in note
    assert main([*given, "--order", "given"]) == 0
    assert "order: 5x5" not in capsys.readouterr().err
    assert "--order: this goes with --light-field" in fails(capsys, "evaluate", "fast", tmp_path, "--order", "given")


def test_evaluate_the_default(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    (tmp_path / "a.png").write_bytes(encode(np.full((16, 16, 3), 90, np.uint8), ".png"))
    assert main(["evaluate", "auto", str(tmp_path), "--degradation", "box", "--json", str(tmp_path / "s.json")]) == 0
    (score,) = json.loads((tmp_path / "s.json").read_text())["scores"]
    assert [picture["file"] for picture in score["pictures"]] == ["a.png"]


def test_evaluate_results_against_their_truth(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    truth = make_light_field()
    views = truth.views.copy()
    views[1, 2] ^= 1
    truth.save(tmp_path / "truth.npz")
    ciir.LightField(views, is_ordered=True, depth_sense="cameras").save(tmp_path / "result.zip")
    given = ["evaluate", "--truth", str(tmp_path / "truth.npz"), str(tmp_path / "result.zip")]
    to_json = ["--json", str(tmp_path / "s.json")]
    assert main([*given, *to_json]) == 0
    printed = capsys.readouterr().out
    (score,) = json.loads((tmp_path / "s.json").read_text())["scores"]
    assert (score["count"], score["identical"]) == (25, 24)
    assert f"result.zip against {given[2]}: PSNR {score['psnr']:.2f} dB, SSIM " in printed
    assert printed.endswith(" on Y over 25 views; 24 are identical and not in the mean PSNR\n")
    assert [(each["v"], each["u"]) for each in score["views"] if each["psnr"] is not None] == [(1, 2)]
    np.save(tmp_path / "true.npy", np.zeros((8, 9), np.float32))
    np.save(tmp_path / "found.npy", np.full((8, 9), 0.1, np.float32))
    assert main(["evaluate", "--truth", str(tmp_path / "true.npy"), str(tmp_path / "found.npy")]) == 0
    assert "BadPix(0.07) 100.00 %, MSE x100 1.000 over 72 pixels" in capsys.readouterr().out
    np.save(tmp_path / "true_confidence.npy", np.eye(8, 9, dtype=np.float32))
    assert main(["evaluate", *given[1:2], str(tmp_path / "true.npy"), str(tmp_path / "found.npy"), *to_json]) == 0
    assert "8 of 72 pixels of true.npy count" in capsys.readouterr().err
    found = json.loads((tmp_path / "s.json").read_text())
    (score,) = found["scores"]
    assert (score["count"], score["not_finite"], score["without_truth"], len(found["notes"])) == (8, 0, 64, 1)
    assert "give results" in fails(capsys, "evaluate", "--truth", tmp_path)
    assert "--grid: this goes with a MODEL" in fails(capsys, *given, "--grid", "3x3")
    assert "--degradation: this goes with a MODEL" in fails(capsys, *given, "--degradation", "box")
    assert "no such folder or file" in fails(capsys, *given[:-1], tmp_path / "gone")


def test_evaluate_folders_by_the_names_of_their_pictures(tmp_path, capsys):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    for folder, names in (("hr", ("a.png", "b.png")), ("up", ("b.png",))):
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).write_bytes(encode(make_picture(20, 20), ".png"))
    given = ["evaluate", "--truth", str(tmp_path / "hr"), str(tmp_path / "up"), "--json", str(tmp_path / "s.json")]
    assert main(given) == 0
    printed = capsys.readouterr()
    assert printed.out.endswith("PSNR inf dB, SSIM 1.0000 on Y over 1 picture\n")
    assert "1 of 2 pictures of hr are compared" in printed.err
    found = json.loads((tmp_path / "s.json").read_text())
    assert found["scores"][0]["pictures"] == [{"file": "b.png", "psnr": None, "ssim": 1}]
    assert printed.err == f"ciir: note: {found['notes'][0]}\n"
