"""Campaigns of primitives over several workers: who dies costs no trial, none counts twice, same bins in the end."""

import threading
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import CallError, SurefootError
from surefoot.lab.footholds.campaign import read
from surefoot.lab.footholds.primitives import PrimitiveJob, Worker, own_worker, paper_trials, run_trials, samples_of
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import ExperimentReply, ExperimentRequest, FootOutcome, PrimitiveTrial, TrialOutcome
from surefoot.services.footholds.learning.samples import gather
from surefoot.services.footholds.models.lattice import Bins, Lattice, filled
from tests.surefoot.expect import expect_error

ROBOT = load_robot("ragno")
TRIALS = paper_trials()


def made_up(trial: PrimitiveTrial) -> TrialOutcome:
    """An outcome that depends on the trial and costs no physics."""
    from surefoot.robot.kinematics import foot_positions

    feet = foot_positions(ROBOT.model, ROBOT.neutral)
    return TrialOutcome(
        status="ok",
        feet=tuple(
            FootOutcome(
                leg=name, sliding=0.01 * trial.height + 1e-4 * k + 1e-5 * trial.yaw, displacement=0.001, before=0.0,
                load=3.5, contact=tuple(feet[k]),
            )
            for k, name in enumerate(ROBOT.leg_names)
        ),
    )  # fmt: skip


def worker(**changes: object) -> Worker:
    def answer(request: ExperimentRequest) -> ExperimentReply:
        told = {"robot": ROBOT.name, "robot_hash": ROBOT.hash, "outcomes": tuple(map(made_up, request.trials))}
        return ExperimentReply(**(told | changes))

    return answer


def dying(after: int) -> Worker:
    asked = {"n": 0}

    def answer(request: ExperimentRequest) -> ExperimentReply:
        asked["n"] += 1
        if asked["n"] > after:
            raise CallError("timeout", "no reply: the simulator was killed")
        return worker()(request)

    return answer


def bins(path: Path) -> Bins:
    found = gather(read(path)[0])
    return filled(Lattice(), found.x, found.r)


def test_the_trials_of_the_paper() -> None:
    assert len(TRIALS) == 105
    assert len({PrimitiveJob(ROBOT, trial).name for trial in TRIALS}) == 105
    assert len(paper_trials(frictions=(0.4, 0.6), seeds=(1, 2), noise=0.003)) == 420


def test_samples_carry_the_coefficients_under_each_foot() -> None:
    for kind, sign in (("hill", 1.0), ("hole", -1.0), ("slope", 0.0)):
        job = PrimitiveJob(ROBOT, PrimitiveTrial(primitive=kind, height=0.03))  # type: ignore[arg-type]
        found = samples_of(job, made_up(job.trial), smooth=False)
        assert len(found) == 6
        for each in found:
            assert each.problem == ""
            assert each.k1 == pytest.approx(sign * each.k2, rel=0.15, abs=2e-3)
            assert each.k2 > 0.004
            assert each.friction == 0.5
    down = samples_of(PrimitiveJob(ROBOT, TRIALS[1]), made_up(TRIALS[1]))
    assert {each.trial for each in down} == {PrimitiveJob(ROBOT, TRIALS[1]).name}


def test_a_worker_that_dies_costs_no_trial_and_none_counts_twice(tmp_path: Path) -> None:
    whole, shared = tmp_path / "whole.jsonl", tmp_path / "shared.jsonl"
    assert run_trials(ROBOT, TRIALS, whole, [worker()]) == 105
    assert run_trials(ROBOT, TRIALS, shared, [worker(), dying(3), dying(0)]) == 105
    assert bins(whole) == bins(shared)
    assert set(read(shared)[1]) == {PrimitiveJob(ROBOT, trial).name for trial in TRIALS}
    assert read(shared)[1] == read(whole)[1]
    assert run_trials(ROBOT, TRIALS, shared, []) == 0  # nothing is left to do


def test_a_campaign_goes_on_where_it_was_left(tmp_path: Path) -> None:
    out = tmp_path / "s.jsonl"
    with expect_error(SurefootError, "no_worker", text="killed"):
        run_trials(ROBOT, TRIALS, out, [dying(5)])
    before = len(read(out)[1])
    assert before == 20
    done: list[str] = []
    assert run_trials(ROBOT, TRIALS, out, [worker()], lambda name, count: done.append(name)) == 105 - before
    assert len(set(done)) == 105 - before


@pytest.mark.parametrize("wrong", [{"robot": "messor"}, {"robot_hash": "0"}, {"outcomes": ()}], ids=str)
def test_a_worker_that_answers_wrong_is_left_out(tmp_path: Path, wrong: dict) -> None:
    out = tmp_path / "s.jsonl"
    with expect_error(SurefootError, "no_worker"):
        run_trials(ROBOT, TRIALS[:4], out, [worker(**wrong)])
    assert run_trials(ROBOT, TRIALS[:4], out, [worker(**wrong), worker()]) == 4


def test_no_worker_and_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SurefootError, match="no worker"):
        run_trials(ROBOT, TRIALS[:4], tmp_path / "s.jsonl", [])
    with expect_error(SurefootError, "unwritable"):
        run_trials(ROBOT, TRIALS[:4], tmp_path / "absent" / "s.jsonl", [worker()])


def test_workers_work_at_the_same_time(tmp_path: Path) -> None:
    meet = threading.Barrier(2, timeout=20.0)
    met: list[int] = []

    def together(request: ExperimentRequest) -> ExperimentReply:
        if not met:
            meet.wait()
            met.append(1)
        return worker()(request)

    assert run_trials(ROBOT, TRIALS[:16], tmp_path / "s.jsonl", [together, together]) == 16


def test_a_real_trial(tmp_path: Path) -> None:
    out = tmp_path / "s.jsonl"
    trials = [PrimitiveTrial(primitive="flat"), PrimitiveTrial(primitive="slope", height=0.04, yaw=3.1416)]
    assert run_trials(ROBOT, trials, out, [own_worker(ROBOT)]) == 2
    found = read(out)[0]
    assert len(found) == 6
    slips = {name: np.mean([s.slip for s in found if name in s.trial]) for name in ("flat", "slope")}
    assert slips["flat"] < slips["slope"]
