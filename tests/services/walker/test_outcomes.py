"""Outcomes of stances go back with the next request, each with the choice that began it."""

from surefoot.schemas.footholds import LegFoothold, LegRequest
from surefoot.services.walker.outcomes import MOST, Outcomes


def choose(outcomes: Outcomes, leg: str, x: float, status: str = "ok") -> None:
    asked = LegRequest(leg=leg, nominal=(x, 0.0, 0.0), stroke=(-0.025, 0.0, 0.0))
    found = None if status == "infeasible" else (x + 0.01, 0.0, 0.0)
    outcomes.chose(asked, LegFoothold(leg=leg, status=status, foothold=found))  # type: ignore[arg-type]


def test_a_stance_belongs_to_the_choice_before_the_one_for_its_next_step() -> None:
    outcomes = Outcomes()
    choose(outcomes, "lf", 0.1)
    outcomes.ended("lf", 0.5)  # the stance of the start: it was not chosen
    assert outcomes.take() == ()
    choose(outcomes, "lf", 0.2)  # it stands at 0.1 and lifts off now
    outcomes.ended("lf", 0.003)
    (found,) = outcomes.take()
    assert (found.foothold, found.nominal, found.slip) == ((0.11, 0.0), (0.1, 0.0), 0.003)
    assert outcomes.take() == ()
    outcomes.ended("lf", 0.004)  # a bounce: the choice stands on
    assert [each.nominal[0] for each in outcomes.take()] == [0.2]


def test_a_choice_that_was_not_stepped_on_leaves_nothing() -> None:
    outcomes = Outcomes()
    for x in (0.1, 0.2):
        choose(outcomes, "rm", x)
    outcomes.ended("rm", 0.0)
    choose(outcomes, "rm", 0.3, "infeasible")
    outcomes.ended("rm", 0.001)
    assert [each.nominal[0] for each in outcomes.take()] == [0.2]
    outcomes.ended("rm", 0.001)
    assert outcomes.take() == ()


def test_outcomes_that_nobody_takes_do_not_pile_up() -> None:
    outcomes = Outcomes()
    for k in range(2 * MOST):
        choose(outcomes, "lf", 0.1 * k)
        outcomes.ended("lf", 0.0)
    assert len(outcomes.take()) == MOST


def test_a_stance_with_a_faulty_sensor_is_marked_and_the_next_is_not() -> None:
    outcomes = Outcomes()
    for x in (0.1, 0.2, 0.3):
        choose(outcomes, "lf", x)
        outcomes.ended("lf", 0.01, healthy=x != 0.2)
    choose(outcomes, "lf", 0.4)
    outcomes.ended("lf", 0.001)
    assert [(each.nominal[0], each.healthy) for each in outcomes.take()] == [(0.1, False), (0.2, True), (0.3, True)]
