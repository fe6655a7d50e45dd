"""Short walks on the in-memory bus; `python -m tests.contract.short_walks` prints their hashes as JSON."""

import dataclasses
import json
import sys

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import Scenario, find_scenario, load_scenario

WALKS = {"rough-terrain": 0.1, "nao-walk": 0.06, "crawl-rough": 0.1, "ragno-goal": 0.17}
"""Scenarios of a hexapod, a biped and a quadruped, with the distance of their walk, m; of a goal behind the robot, with
what is walked backwards of the way to `GOAL`."""

GOAL = (-0.32, 0.1)
"""Position (2,) m, frame map: a turn in place, many postures of the stance, in 28 s of simulated time."""


def short(name: str, distance: float) -> Scenario:
    """Return a shipped scenario that walks this distance, or to `GOAL`, without limits."""
    scenario, less = load_scenario(find_scenario(name)), {"walk": {"distance": distance}, "goto": {"position": GOAL}}
    steps = tuple(
        dataclasses.replace(step, request=step.request.model_copy(update=less[step.do]))
        if step.do in less and step.request is not None
        else step
        for step in scenario.steps
    )
    return dataclasses.replace(scenario, steps=steps, limits={}, settle_s=0.1)


def walk(name: str) -> str:
    """Return the hash of a short walk that has made its steps."""
    run = run_local(short(name, WALKS[name]))
    problems, distance = run.verdict.problems, run.verdict.value("distance_m")
    if problems or distance is None or abs(distance) < 0.8 * WALKS[name]:
        raise RuntimeError(f"{name} has not walked: {distance} m {problems}")
    return run.run_hash


if __name__ == "__main__":
    sys.stdout.write(json.dumps({name: walk(name) for name in WALKS}) + "\n")
