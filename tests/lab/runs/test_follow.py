"""A run that stalls, loses a service for good or is interrupted comes to its report."""

import threading
from types import SimpleNamespace
from typing import Any

from surefoot.errors import BusError
from surefoot.lab.runs import live
from surefoot.schemas.system import RecorderReply
from surefoot.services.supervisor.processes.session import Session


class Stuck:
    """A session in which no tick comes."""

    def __init__(self, error: Exception | None = None) -> None:
        self.error = error
        self.supervisor = SimpleNamespace(ended=threading.Event(), ticks=7, wall_s=1.0, director=None)

    def step(self) -> None:
        if self.error is not None:
            raise self.error

    def health(self) -> dict[str, Any]:
        return {"walker": SimpleNamespace(waiting_for=("state/velocity",))}


def follow(session: Stuck) -> list[str]:
    made: Any = session
    return Session.follow(made, 0.0, 0.1, lambda ticks, wall_s: None)[1]


def test_a_stall_is_a_problem_of_the_verdict() -> None:
    (problem,) = follow(Stuck())
    assert problem == "no tick for 0.1 s at tick 7: walker waits for state/velocity"


def test_a_service_that_is_given_up_is_a_problem_of_the_verdict() -> None:
    assert follow(Stuck(BusError("service_failed", "walker does not run"))) == ["walker does not run"]


def test_an_interrupted_run_does_not_wait_for_the_last_tick() -> None:
    unfinished, asked = RecorderReply(path="x", epoch=1, tick=5, messages=9, finished=False), []
    session: Any = SimpleNamespace(call=lambda *words: asked.append(words) or unfinished)
    assert live.recorder_of(session, 0.0) == unfinished
    assert len(asked) == 1


def test_a_run_waits_longer_than_the_driver_holds() -> None:
    from surefoot.lockstep.driver import HOLD_S

    assert live.STALL_S > HOLD_S
