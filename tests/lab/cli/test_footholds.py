"""`surefoot footholds`: every verb on small files, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.heightmap_exchange import save_png
from surefoot.lab.cli.main import main
from surefoot.services.footholds.learning.samples import trial_lines
from surefoot.services.footholds.models.files import load
from tests.services.footholds.learning.made import samples
from tests.surefoot.geometry.maps import save_asc


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as end:
        main(["footholds", *arguments])
    return int(end.value.code or 0), capsys.readouterr().out


def sample_file(path: Path, seed: int = 0, prefix: str = "a") -> Path:
    made = samples(300, seed, trials=6)
    lines = [line for t in sorted({s.trial for s in made}) for line in _trial(f"{prefix}{t}", made, t)]
    path.write_text("\n".join(lines))
    return path


def _trial(name: str, made: list, trial: str) -> list[str]:
    from dataclasses import replace

    return list(trial_lines(name, [replace(s, trial=name) for s in made if s.trial == trial]))


def test_learn_merge_show_and_score(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = sample_file(tmp_path / "a.jsonl"), sample_file(tmp_path / "b.jsonl", 1, "b")
    for name, files in (("a", [a]), ("b", [b]), ("both", [a, b])):
        assert run(capsys, "learn", *map(str, files), "-o", str(tmp_path / f"{name}.json"))[0] == 0
    code, _ = run(capsys, "merge", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "-o", str(tmp_path / "m.json"))
    assert code == 0
    assert load(tmp_path / "m.json").bins == load(tmp_path / "both.json").bins
    code, text = run(capsys, "show", str(tmp_path / "m.json"), "--json", "--picture", str(tmp_path / "m.png"))
    assert code == 0
    assert json.loads(text)["model"] == "learned/600"
    assert (tmp_path / "m.png").stat().st_size > 10_000
    rows = "\n".join(" ".join("0" for _ in range(30)) for _ in range(20))
    grid = tmp_path / "map.asc"
    grid.write_text(f"ncols 30\nnrows 20\nxllcorner 0\nyllcorner 0\ncellsize 0.005\n{rows}\n")
    code, text = run(capsys, "score", str(grid), "--model", "ragno", "-o", str(tmp_path / "s.npz"), "--json")
    assert code == 0
    assert json.loads(text)["cells"]["free"] == 28 * 18
    with np.load(tmp_path / "s.npz") as found:
        assert found["p"].shape == (20, 30)
        assert np.nanmax(found["p"]) < 0.1
        assert list(found["mask_names"])[-1] == "unlearned"


def test_a_png_is_scored_as_the_grid_it_came_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    x = 0.02 * np.sin(0.3 * np.arange(40.0))
    heights = HeightMap(z=np.add.outer(x[:30], x).astype(np.float32), cell=0.005)
    found = []
    for path in (save_asc(heights, tmp_path / "m.asc"), save_png(heights, tmp_path / "m.png")):
        out = tmp_path / f"{path.suffix[1:]}.npz"
        assert run(capsys, "score", str(path), "--model", "ragno", "-o", str(out))[0] == 0
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
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(capsys, *arguments)[0] != 0


def test_a_map_of_another_cell_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid = tmp_path / "map.asc"
    grid.write_text("ncols 4\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 0.02\n0 0 0 0\n")
    assert run(capsys, "score", str(grid), "--model", "ragno", "-o", str(tmp_path / "s.npz"))[0] != 0


def test_primitives_go_on_with_their_file(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    from surefoot.lab.footholds import primitives

    monkeypatch.setattr(primitives, "HEIGHTS", (0.02,))
    monkeypatch.setattr(primitives, "SYMMETRY", dict.fromkeys(primitives.PRIMITIVES, 1))
    out = tmp_path / "p.jsonl"
    code, text = run(capsys, "primitives", "-o", str(out), "--json")
    assert code == 0
    assert json.loads(text) == {"out": str(out), "trials": 7, "done": 7, "samples": 21}
    assert json.loads(run(capsys, "primitives", "-o", str(out), "--json")[1])["done"] == 0
    assert run(capsys, "primitives", "-o", str(out), "--worker", "nowhere")[0] != 0
    assert run(capsys, "primitives", "-o", str(out), "--stance", "four")[0] != 0


def test_judge_a_model_by_other_trials(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = sample_file(tmp_path / "a.jsonl"), sample_file(tmp_path / "b.jsonl", 1, "b")
    run(capsys, "learn", str(a), "-o", str(tmp_path / "a.json"))
    code, text = run(capsys, "judge", str(tmp_path / "a.json"), str(b), "--json")
    assert code == 0
    assert json.loads(text)["stances"] == 300
    assert json.loads(text)["spearman"] > 0.8
    (tmp_path / "none.jsonl").write_text("")
    assert run(capsys, "judge", str(tmp_path / "a.json"), str(tmp_path / "none.jsonl"))[0] != 0
