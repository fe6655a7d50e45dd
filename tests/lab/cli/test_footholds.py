"""`surefoot footholds`: every verb on small files, and what it refuses."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.footholds.learning.samples import trial_lines
from surefoot.services.footholds.models.files import load
from surefoot.services.footholds.models.shipped import shipped
from tests.services.footholds.learning.made import samples
from tests.surefoot.geometry.maps import save_asc


def sample_file(path: Path, seed: int = 0, prefix: str = "a") -> Path:
    made = samples(300, seed, trials=6)
    lines = [line for t in sorted({s.trial for s in made}) for line in _trial(f"{prefix}{t}", made, t)]
    path.write_text("\n".join(lines))
    return path


def _trial(name: str, made: list, trial: str) -> list[str]:
    from dataclasses import replace

    return list(trial_lines(name, [replace(s, trial=name) for s in made if s.trial == trial]))


def test_learn_merge_show_and_score(tmp_path: Path, answer: Any) -> None:
    a, b = sample_file(tmp_path / "a.jsonl"), sample_file(tmp_path / "b.jsonl", 1, "b")
    for name, files in (("a", [a]), ("b", [b]), ("both", [a, b])):
        answer("footholds", "learn", *files, "-o", tmp_path / f"{name}.json")
    answer("footholds", "merge", tmp_path / "a.json", tmp_path / "b.json", "-o", tmp_path / "m.json")
    assert load(tmp_path / "m.json").bins == load(tmp_path / "both.json").bins
    text = answer("footholds", "show", tmp_path / "m.json", "--json", "--picture", tmp_path / "m.png")
    assert json.loads(text)["model"] == "learned/600"
    assert (tmp_path / "m.png").stat().st_size > 10_000
    rows = "\n".join(" ".join("0" for _ in range(30)) for _ in range(20))
    grid = tmp_path / "map.asc"
    grid.write_text(f"ncols 30\nnrows 20\nxllcorner 0\nyllcorner 0\ncellsize 0.005\n{rows}\n")
    made = ("-o", tmp_path / "s.npz", "--picture", tmp_path / "s.png")
    text = answer("footholds", "score", grid, "--model", "ragno", *made, "--json")
    with Image.open(tmp_path / "s.png") as drawn:
        assert len(drawn.convert("RGB").getcolors(1 << 24) or ()) > 50  # colours of four layers, not an empty sheet
    assert json.loads(text)["cells"]["free"] == 28 * 18
    with np.load(tmp_path / "s.npz") as found:
        assert found["p"].shape == (20, 30)
        assert np.nanmax(found["p"]) < 0.1
        assert list(found["mask_names"])[-1] == "unlearned"


def test_tune_writes_the_weight_of_the_best_walks(tmp_path: Path, answer: Any) -> None:
    model = tmp_path / "m.json"
    shutil.copy(shipped("ragno"), model)
    short = ("--ground", "rough:0.04", "--seeds", "500:501", "--distance", "0.1")
    found = json.loads(answer("footholds", "tune", model, "--weights", "0.5,3", *short, "--json"))
    tried = {each["weight"]: (each["failed"], each["sliding_mm"]) for each in found["tried"]}
    assert set(tried) == {0.5, 3.0}
    assert min(tried, key=tried.__getitem__) == found["chosen"] == load(model).distance_weight


def test_a_png_is_scored_as_the_grid_it_came_from(tmp_path: Path, answer: Any) -> None:
    x = 0.02 * np.sin(0.3 * np.arange(40.0))
    heights = HeightMap(z=np.add.outer(x[:30], x).astype(np.float32), cell=0.005)
    pixels = np.rint((heights.z[::-1] + 0.05) / 0.1 * 65535.0).astype(np.uint16)  # the top row is y-max
    Image.fromarray(pixels).save(tmp_path / "m.png")
    (tmp_path / "m.json").write_text('{"cell": 0.005, "z_low": -0.05, "z_high": 0.05}')
    found = []
    for path in (save_asc(heights, tmp_path / "m.asc"), tmp_path / "m.png"):
        out = tmp_path / f"{path.suffix[1:]}.npz"
        answer("footholds", "score", path, "--model", "ragno", "-o", out)
        with np.load(out) as layers:
            found.append(layers["p"])
    assert np.isfinite(found[0]).sum() > 900
    np.testing.assert_allclose(found[0], found[1], atol=2e-3)


@pytest.mark.parametrize(
    "arguments",
    [
        ("show", "nowhere.json"),
        ("learn", "nowhere.jsonl", "-o", "m.json"),
        ("score", "nowhere.asc", "--model", "ragno", "-o", "s.npz"),
        ("collect", "-o", "s.jsonl", "--ground", "moon"),
        ("collect", "-o", "s.jsonl", "--seeds", "9:3"),
        ("collect", "-o", "s.jsonl", "--ground", "rough:high"),
        ("merge", "nowhere.json", "nowhere.json", "-o", "m.json"),
    ],
)
def test_refusals_are_exit_codes(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert in_process("footholds", *arguments)[0] != 0


def test_a_map_of_another_cell_is_refused(tmp_path: Path, in_process: Any) -> None:
    grid = tmp_path / "map.asc"
    grid.write_text("ncols 4\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 0.02\n0 0 0 0\n")
    assert in_process("footholds", "score", grid, "--model", "ragno", "-o", tmp_path / "s.npz")[0] != 0


def test_primitives_go_on_with_their_file(tmp_path: Path, answer: Any, in_process: Any, monkeypatch) -> None:
    from surefoot.lab.footholds import primitives

    monkeypatch.setattr(primitives, "HEIGHTS", (0.02,))
    monkeypatch.setattr(primitives, "SYMMETRY", dict.fromkeys(primitives.PRIMITIVES, 1))
    out = tmp_path / "p.jsonl"
    text = answer("footholds", "primitives", "-o", out, "--json")
    assert json.loads(text) == {"out": str(out), "trials": 7, "done": 7, "samples": 21}
    assert json.loads(in_process("footholds", "primitives", "-o", out, "--json")[1])["done"] == 0
    assert in_process("footholds", "primitives", "-o", out, "--worker", "nowhere")[0] != 0
    assert in_process("footholds", "primitives", "-o", out, "--stance", "four")[0] != 0


def test_judge_a_model_by_other_trials(tmp_path: Path, answer: Any, in_process: Any) -> None:
    a, b = sample_file(tmp_path / "a.jsonl"), sample_file(tmp_path / "b.jsonl", 1, "b")
    in_process("footholds", "learn", a, "-o", tmp_path / "a.json")
    text = answer("footholds", "judge", tmp_path / "a.json", b, "--json")
    assert json.loads(text)["stances"] == 300
    assert json.loads(text)["spearman"] > 0.8
    (tmp_path / "none.jsonl").write_text("")
    assert in_process("footholds", "judge", tmp_path / "a.json", tmp_path / "none.jsonl")[0] != 0
