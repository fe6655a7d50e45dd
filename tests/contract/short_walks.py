"""Short walks on the in-memory bus; `python -m tests.contract.short_walks` prints their hashes as JSON."""

import dataclasses
import json
import sys

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import Scenario, find_scenario, load_scenario

WALKS = {"rough-terrain": 0.1, "nao-walk": 0.06, "crawl-rough": 0.1}
"""Scenarios of a hexapod, a biped and a quadruped, with the distance of their walk, m."""


def short(name: str, distance: float) -> Scenario:
    """Return a shipped scenario that walks this distance, without limits."""
    scenario = load_scenario(find_scenario(name))
    steps = tuple(
        dataclasses.replace(step, request=step.request.model_copy(update={"distance": distance}))
        if step.do == "walk" and step.request is not None
        else step
        for step in scenario.steps
    )
    return dataclasses.replace(scenario, steps=steps, limits={}, settle_s=0.1)


def walk(name: str) -> str:
    """Return the hash of a short walk that has made its steps."""
    run = run_local(short(name, WALKS[name]))
    problems, distance = run.verdict.problems, run.verdict.value("distance_m")
    if problems or distance is None or distance < 0.8 * WALKS[name]:
        raise RuntimeError(f"{name} has not walked: {distance} m {problems}")
    return run.run_hash


if __name__ == "__main__":
    sys.stdout.write(json.dumps({name: walk(name) for name in WALKS}) + "\n")
