"""Table of visible processes: the same answers as a plain search, at a cost that does not grow with the tokens."""

import time

import numpy as np

from services.supervisor.processes.visible import Visible
from surefoot.bus.interface import Life

DRIVER = "driver"


def searched(shown: list[tuple[str, str]]) -> tuple[str, set[str], tuple[str, ...]]:
    """Service that drives or one of them, all processes that may drive, and services, by search of all tokens."""
    driving = {instance for service, instance in shown if service == DRIVER}
    drivers = {instance for service, instance in shown if service != DRIVER and instance in driving}
    services = tuple(sorted({service for service, _ in shown if service != DRIVER}))
    return next((service for service, one in shown if service != DRIVER and one in driving), ""), drivers, services


def test_it_answers_as_a_search_of_all_tokens_whatever_comes_and_goes() -> None:
    random = np.random.default_rng(5)
    visible, shown = Visible(), list[tuple[str, str]]()
    for _ in range(3000):
        place = str(random.choice(["a", "b", DRIVER])), str(random.integers(6))
        if random.random() < 0.5:
            if place in shown:
                shown.remove(place)
            assert visible.note(Life(*place, False)) == any(service == place[0] for service, _ in shown)
        else:
            if place not in shown:
                shown.append(place)
            assert visible.note(Life(*place, True))
        driver, drivers, services = searched(shown)
        assert bool(visible.driver) == bool(driver)
        assert visible.services == services
        assert (visible.instance_of(DRIVER) in drivers) if drivers else visible.instance_of(DRIVER) == ""
        if drivers:  # the service that drives shows the token of the process that drives
            assert (visible.driver, visible.instance_of(DRIVER)) in shown
        for name in services:
            of_it = [one for service, one in shown if service == name]
            first = [one for one in of_it if one in drivers] or of_it
            assert visible.instance_of(name) in first


def test_a_token_costs_the_same_beside_thousands_of_others() -> None:
    def cost(number: int) -> float:
        """Least processor time of 200 notices beside so many tokens, s."""
        visible = Visible()
        for i in range(number):
            visible.note(Life(DRIVER, f"x{i}", True))
        visible.note(Life("a", "1", True))
        visible.note(Life(DRIVER, "1", True))
        found = list[float]()
        for trial in range(5):
            began = time.process_time()
            for i in range(200):
                visible.note(Life(DRIVER, f"y{trial}-{i}", True))
                assert visible.instance_of(DRIVER) == "1"
                assert visible.driver == "a"
            found.append(time.process_time() - began)
        return min(found)

    assert cost(20_000) < 10.0 * cost(200) + 1e-3
