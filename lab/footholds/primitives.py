"""Campaigns of ground primitives (Walas & Belter 2011, section 3.1), shared among simulators on the network.

A batch of trials goes to the next free worker. The batch of a failed worker goes to another one, and the failed worker
gets no more. Only this process writes the sample file, complete trials only, so that no trial counts twice. The name
of a trial determines its result on every worker.
"""

import itertools
import math
import queue
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np

from surefoot.errors import SurefootError
from surefoot.robot import kinematics
from surefoot.robot.description import Robot
from surefoot.schemas.sim import ExperimentReply, ExperimentRequest, Primitive, PrimitiveTrial, TrialOutcome
from surefoot.services.footholds.ground import build_ground
from surefoot.services.footholds.learning.samples import StanceSample
from surefoot.services.footholds.outcomes import sample_at
from surefoot.services.simulator.experiment import outcome_of, primitive_ground

from .campaign import append, read

PRIMITIVES: tuple[Primitive, ...] = get_args(Primitive)
HEIGHTS = (0.01, 0.02, 0.03, 0.04)
"""Heights of the ground primitives, m (Walas & Belter 2011, section 3.1); flat ground has one trial only."""
YAW_STEP = math.radians(45.0)
SYMMETRY: dict[Primitive, int] = {"flat": 1, "slope": 8, "edge": 8, "hill": 1, "ridge": 4, "hole": 1, "groove": 4}
"""Number of distinct headings, in steps of 45 deg, of each ground primitive (1 = rotationally symmetric)."""
BATCH = 4
"""Number of trials in one request to a worker; if the worker fails, the batch goes to another one."""
Worker = Callable[[ExperimentRequest], ExperimentReply]
"""Function that simulates the trials of a request and returns their outcomes; raises SurefootError if it fails."""


@dataclass(frozen=True)
class PrimitiveJob:
    """Trial of a campaign of ground primitives, and the robot that is simulated in it."""

    robot: Robot
    trial: PrimitiveTrial

    @cached_property
    def name(self) -> str:
        """Name of the trial in the sample file; two jobs of one name are the same trial."""
        t = self.trial
        where = f"{t.primitive}-{t.height:g}-{math.degrees(t.yaw):.0f}-{t.offset:g}-{math.degrees(t.offset_yaw):.0f}"
        return f"{self.robot.name}-{where}-{t.friction:g}-{t.noise:g}-{t.stance}-{t.stroke:g}-{t.seed}"


Jobs = tuple[PrimitiveJob, ...]
Answer = tuple[Jobs, ExperimentReply | SurefootError]


def paper_trials(
    frictions: Sequence[float] = (0.5,), noise: float = 0.0, seeds: Sequence[int] = (0,), offset: float = 0.0,
    stance: str = "tripod",
) -> list[PrimitiveTrial]:  # fmt: skip
    """Return the trials of Walas & Belter (2011): seven primitives, four heights, distinct 45 deg turns; 105 per set.

    Args:
        frictions: friction coefficients of the ground; each gives a set of trials.
        noise: standard deviation of the ground height, m.
        seeds: seeds of noise and direction of the offset; each gives a set of trials.
        offset: horizontal distance of the feet from the middle of the primitive, m.
        stance: number of standing feet, `six` or `tripod` (three).
    """
    out: list[PrimitiveTrial] = []
    for seed, friction, kind in itertools.product(seeds, frictions, PRIMITIVES):
        way = np.random.default_rng((seed, PRIMITIVES.index(kind))).uniform(0.0, 2.0 * math.pi) if offset else 0.0
        for height, k in itertools.product(HEIGHTS[:1] if kind == "flat" else HEIGHTS, range(SYMMETRY[kind])):
            out.append(
                PrimitiveTrial(
                    primitive=kind, height=height, yaw=k * YAW_STEP, friction=friction, noise=noise, offset=offset,
                    offset_yaw=float(way), stance=stance, seed=seed,  # type: ignore[arg-type]
                )
            )  # fmt: skip
    return out


def samples_of(job: PrimitiveJob, outcome: TrialOutcome, smooth: bool = True) -> list[StanceSample]:
    """Return a learning sample of each foot of a trial: ground coefficients at its contact, slip and load.

    `smooth`: True: the height map is filtered by a 3 x 3 median, as in the service; False: it is not.
    """
    robot, trial = job.robot, job.trial
    feet = kinematics.foot_positions(robot.model, robot.neutral)[:, :2]
    ground = build_ground(primitive_ground(feet, trial).map, robot.foot_radius, smooth)
    out: list[StanceSample] = []
    for each in outcome.feet:
        leg = robot.leg_names.index(each.leg)
        at, middle = (each.contact[0], each.contact[1]), (float(feet[leg, 0]), float(feet[leg, 1]))
        sample = sample_at(
            ground, at, middle, (-trial.stroke, 0.0, 0.0), each.sliding, (job.name, leg, 0), each.displacement,
            each.load,
        )  # fmt: skip
        source = f"primitives, {trial.stance}, {outcome.status}"
        out.append(replace(sample, friction=trial.friction, robot=robot.name, robot_hash=robot.hash, source=source))
    return out


def own_worker(robot: Robot) -> Worker:
    """Return a worker that simulates trials of ground primitives in this process."""

    def answer(request: ExperimentRequest) -> ExperimentReply:
        outcomes = tuple(outcome_of(robot, trial) for trial in request.trials)
        return ExperimentReply(robot=robot.name, robot_hash=robot.hash, outcomes=outcomes)

    return answer


def run_trials(
    robot: Robot, trials: Sequence[PrimitiveTrial], out: Path, workers: Sequence[Worker],
    show: Callable[[str, int], None] = lambda name, count: None,
) -> int:  # fmt: skip
    """Run the trials that a sample file lacks and append their samples; return the number of trials run.

    Args:
        robot: robot that every worker must simulate.
        trials: all trials of the campaign.
        out: sample file.
        workers: simulators, each served by a thread.
        show: called with the name of each finished trial and its number of samples.

    Raises:
        SurefootError: `no_worker` if all workers failed, with the reason of the last; `unwritable`: the sample file.
    """
    done = read(out)[1] if out.exists() else {}
    jobs = {job.name: job for job in (PrimitiveJob(robot, trial) for trial in trials) if job.name not in done}
    append(out)
    waiting: queue.SimpleQueue[Jobs] = queue.SimpleQueue()
    every = list(jobs.values())
    for k in range(0, len(every), BATCH):
        waiting.put(tuple(every[k : k + BATCH]))
    found: queue.SimpleQueue[Answer] = queue.SimpleQueue()
    ended = threading.Event()
    threads = [
        threading.Thread(target=_work, args=(robot, worker, waiting, found, ended), daemon=True) for worker in workers
    ]
    for thread in threads:
        thread.start()
    left, alive, why = len(jobs), len(threads), "there is no worker"
    try:
        while left:
            if not alive:
                raise SurefootError("no_worker", f"{left} trials are left, and no worker: {why}", "workers")
            batch, reply = found.get()
            if isinstance(reply, SurefootError):
                alive, why = alive - 1, reply.message
                waiting.put(batch)
                continue
            for job, outcome in zip(batch, reply.outcomes, strict=True):
                samples = samples_of(job, outcome)
                append(out, job.name, samples)
                show(job.name, len(samples))
            left -= len(batch)
    finally:
        ended.set()
    return len(jobs)


def _work(
    robot: Robot, worker: Worker, waiting: "queue.SimpleQueue[Jobs]", found: "queue.SimpleQueue[Answer]",
    ended: threading.Event,
) -> None:  # fmt: skip
    """Run batches of trials on one worker until the campaign has ended or the worker fails."""
    while not ended.is_set():
        try:
            batch = waiting.get(timeout=0.1)
        except queue.Empty:
            continue
        reply = _asked(robot, worker, batch)
        found.put((batch, reply))
        if isinstance(reply, SurefootError):
            return


def _asked(robot: Robot, worker: Worker, batch: Sequence[PrimitiveJob]) -> ExperimentReply | SurefootError:
    try:
        reply = worker(ExperimentRequest(trials=tuple(job.trial for job in batch)))
    except SurefootError as error:
        return error
    if (reply.robot, reply.robot_hash) != (robot.name, robot.hash):
        return SurefootError("other_robot", f"a worker simulates {reply.robot!r}, not {robot.name!r} as it is here")
    if len(reply.outcomes) != len(batch):
        return SurefootError("invalid", f"a worker answered {len(reply.outcomes)} of {len(batch)} trials")
    return reply
