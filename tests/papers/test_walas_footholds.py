"""The foothold reproduction: its arithmetic on made-up walks, its folder, its figures; physics is tested elsewhere."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.lab.footholds import primitives
from surefoot.papers.walas import foothold_runs, footholds
from surefoot.papers.walas.finders import finder, kept
from surefoot.papers.walas.foothold_runs import Runs, WalkKey, WalkResult
from surefoot.services.footholds.learning.fit import Candidate
from tests.lab.footholds.test_primitives import worker
from tests.services.footholds.learning.made import samples

SLIPS = {"flat": 0.01, "nominal": 0.05, "random": 0.2, "random collection": 0.2, "terrain": 0.08,
         "primitives K1, K2": 0.1, "primitives K1..K3": 0.06, "Gaussian": 0.04, "Gaussian, k = 8": 0.05,
         "without edges": 0.2, "re-learned, c = 1": 0.08, "re-learned, c = 0.5": 0.07}  # fmt: skip


def made_up(key: WalkKey) -> dict:
    """A walk whose slips are known."""
    rng = np.random.default_rng((key.seed, len(key.case)))
    r = SLIPS[key.case] * rng.uniform(0.8, 1.2, 60)
    robot = foothold_runs.load_robot("ragno").hash
    stances = [replace(s, trial=f"{key.case} {key.seed}", robot_hash=robot) for s in samples(60, seed=key.seed)]
    return {
        "case": key.case, "seed": key.seed, "fell": False,
        "rows": [(1 + k // 3, float(v), 2.0 * float(v)) for k, v in enumerate(r)],
        "samples": [asdict(s) for s in stances],
    }  # fmt: skip


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[WalkKey]:
    asked: list[WalkKey] = []

    def walked(key: WalkKey) -> dict:
        asked.append(key)
        return made_up(key)

    monkeypatch.setattr(foothold_runs, "walked", walked)
    monkeypatch.setattr(foothold_runs, "own_worker", lambda robot: worker())
    monkeypatch.setattr(primitives, "HEIGHTS", (0.02,))
    monkeypatch.setattr(primitives, "SYMMETRY", dict.fromkeys(primitives.PRIMITIVES, 1))
    monkeypatch.setattr(footholds, "ELEMENTARY", Candidate(4, 0.0, 1e-5, find=finder("elementary", 4, 60)))
    monkeypatch.setattr(footholds, "BLIND", Candidate(4, 0.0, 1e-5, find=finder("elementary", 4, 60, blind=True)))
    monkeypatch.setattr(footholds, "GAUSSIANS", Candidate(4, 0.0, 1e-5, find=finder("gaussian", 4, 60)))
    monkeypatch.setattr(footholds, "WALKED", Candidate(12, 0.1, 1e-4))
    return asked


def test_every_figure_has_its_claims_and_a_drawing(quick: list[WalkKey], tmp_path: Path) -> None:
    found = footholds.reproduce(tmp_path, seeds=3, jobs=1)
    for number in range(7, 13):
        assert any(f"Fig. {number}" in f.where or f"Figs 8, {number}" in f.where for f in found.findings), number
    assert [path.name[:5] for path in found.figures] == [f"fig{n:02d}" for n in range(7, 13)]
    assert all(path.stat().st_size > 5000 for path in found.figures)
    claims = {f.what: f for f in found.findings}
    assert claims["slip of Gaussian over random (95 %)"].ok
    assert claims["slip of Gaussian over random (95 %)"].ours.startswith("0.20")
    assert claims["slip of primitives K1..K3 over terrain (95 %)"].ok
    assert claims["slip of re-learned, c = 1 over without edges (95 %)"].ok
    assert claims["slip without edges over random (95 %)"].ok
    assert claims["falls in 24 walks"].ok
    assert len(quick) == 4 + 3 * 11
    quick.clear()
    again = footholds.study(tmp_path, 3, jobs=1)
    assert footholds.findings(again) == found.findings
    assert quick == []  # the folder has all of it
    model = kept(str(tmp_path / "primitives-K1--K2.model"))
    assert not model.terms.basis.rates[:, 2].any()  # the third input is left out
    assert len(kept(str(tmp_path / "re-learned--c---0-5.model")).provenance) >= 3


def test_accumulated_slip_is_the_sum_over_stances() -> None:
    walk = WalkResult("x", 0, False, ((1, 0.1, 0.2), (1, 0.2, 0.3), (3, 0.5, 0.6), (9, 1.0, 1.0)), ())
    np.testing.assert_allclose(walk.accumulated(4), [0.3, 0.3, 0.8, 0.8])
    np.testing.assert_allclose(walk.accumulated(2, 2), [0.5, 0.5])
    assert walk.steps == 9


def test_a_torn_line_of_the_folder_is_done_again(quick: list[WalkKey], tmp_path: Path) -> None:
    keys = [WalkKey("random", seed) for seed in (1, 2)]
    Runs(tmp_path, 1).walks(keys)
    lines = (tmp_path / "walks.jsonl").read_text().splitlines()
    (tmp_path / "walks.jsonl").write_text(lines[0] + "\n" + lines[1][:40] + "\n")
    quick.clear()
    again = Runs(tmp_path, 1).walks(keys)
    assert [key.seed for key in quick] == [2]
    assert [each.seed for each in again] == [1, 2]
