"""Properties of the reconciler against a simulated world; no process is started."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.services.supervisor.processes.reconcile import (
    BACKOFF_MAX_S,
    STABLE_S,
    Observed,
    Wanted,
    backoff_s,
    failures_after,
    plan,
    settled,
)

RUNNING = Observed(phase="running", since=0.0)
HEALTHY = Observed(phase="running", since=0.0, healthy=True, healthy_since=1.0)


@st.composite
def systems(draw):
    """Up to six services, each depending on some of those before it."""
    wanted = []
    for i in range(draw(st.integers(1, 6))):
        needs = draw(st.lists(st.integers(0, i - 1), unique=True)) if i else []
        wanted.append(
            Wanted(
                name=f"s{i}",
                after=tuple((f"s{j}", draw(st.booleans())) for j in needs),
                restart=draw(st.sampled_from(["no", "always", "on-failure", "unless-stopped"])),
                grace_s=draw(st.floats(0.0, 3.0)),
                start_period_s=draw(st.floats(0.1, 5.0)),
                watched=draw(st.booleans()),
            )
        )
    return tuple(wanted)


observations = st.builds(
    Observed,
    phase=st.sampled_from(["absent", "running", "exited"]),
    since=st.floats(0, 50),
    healthy=st.booleans(),
    unhealthy_since=st.none() | st.floats(0, 50),
    stopping_since=st.none() | st.floats(0, 50),
    killed=st.booleans(),
    exit_code=st.none() | st.integers(-15, 3),
    failures=st.integers(0, 12),
)


@given(systems(), st.data(), st.floats(0, 100), st.booleans())
def test_at_most_one_action_each_and_only_sensible_ones(wanted, data, now, shutdown):
    names = [*(item.name for item in wanted), "stranger"]
    observed = {name: data.draw(observations) for name in names if data.draw(st.booleans())}
    actions = plan(wanted, observed, now, shutdown=shutdown)
    assert len({action.service for action in actions}) == len(actions)
    by_name = {item.name: item for item in wanted}
    for action in actions:
        state = observed.get(action.service, Observed())
        if action.verb == "start":
            assert not shutdown
            assert state.phase != "running"
            for need, healthy in by_name[action.service].after:
                assert observed[need].phase == "running"
                assert observed[need].healthy or not healthy
        if action.verb == "stop":
            assert state.phase == "running"
            assert state.stopping_since is None
        if action.verb == "kill":
            assert state.phase == "running"
            assert now >= state.stopping_since + by_name.get(action.service, Wanted("")).grace_s
            assert not state.killed
        if action.until is not None:
            assert action.until >= now


class FakeWorld:
    """Processes that become healthy, crash at once, or ignore SIGTERM, on a clock that only this class moves."""

    def __init__(self, wanted, crashes, deaf):
        self.wanted = wanted
        self.crashes = dict(crashes)
        self.deaf = deaf
        self.observed = {}
        self.now = 0.0
        self.started = []
        self.ended = []

    def end(self, name, code):
        state = self.observed[name]
        failures = failures_after(state, self.now)
        self.observed[name] = Observed(phase="exited", since=self.now, exit_code=code, failures=failures)
        self.ended.append(name)

    def advance(self, *, shutdown=False):
        for action in plan(self.wanted, self.observed, self.now, shutdown=shutdown):
            name = action.service
            state = self.observed.get(name, Observed())
            if action.verb == "start":
                self.started.append(name)
                self.observed[name] = Observed(phase="running", since=self.now, failures=state.failures)
            elif action.verb == "stop":
                self.observed[name] = replace(state, stopping_since=self.now)
                if name not in self.deaf:
                    self.end(name, 0)
            elif action.verb == "kill":
                self.end(name, -9)
        self.now += 0.05
        for name, state in list(self.observed.items()):
            if state.phase == "running" and not state.healthy and state.stopping_since is None:
                if self.crashes.get(name, 0) > 0:
                    self.crashes[name] -= 1
                    self.end(name, 1)
                else:
                    self.observed[name] = replace(state, healthy=True, healthy_since=self.now)


@given(systems(), st.data())
def test_reaches_health_and_then_stops_in_order(wanted, data):
    wanted = tuple(replace(item, restart="always") for item in wanted)
    crashes = {item.name: data.draw(st.integers(0, 4)) for item in wanted}
    deaf = {item.name for item in wanted if data.draw(st.booleans())}
    world = FakeWorld(wanted, crashes, deaf)
    for _ in range(2000):
        world.advance()
        if settled(wanted, world.observed):
            break
    assert settled(wanted, world.observed)
    first = [world.started.index(item.name) for item in wanted]
    for item, position in zip(wanted, first, strict=True):
        assert all(world.started.index(need) < position for need, _ in item.after)
        assert world.started.count(item.name) == crashes[item.name] + 1
    world.ended.clear()
    for _ in range(2000):
        world.advance(shutdown=True)
        if all(state.phase == "exited" for state in world.observed.values()):
            break
    order = {name: i for i, name in enumerate(world.ended)}
    assert set(order) == {item.name for item in wanted}
    for item in wanted:
        assert all(order[item.name] < order[need] for need, _ in item.after)


def test_nothing_to_do_for_a_healthy_system():
    assert plan((Wanted("a"), Wanted("b", after=(("a", True),))), {"a": HEALTHY, "b": HEALTHY}, 5.0) == ()


def test_a_service_that_nobody_wants_any_more_is_stopped():
    (action,) = plan((), {"old": HEALTHY}, 5.0)
    assert (action.verb, action.service) == ("stop", "old")


@pytest.mark.parametrize(
    ("restart", "code", "verb"),
    [("no", 1, None), ("on-failure", 0, None), ("on-failure", -9, "start"), ("always", 0, "start")],
)
def test_restart_policies(restart, code, verb):
    ended = Observed(phase="exited", since=0.0, exit_code=code, failures=1)
    actions = plan((Wanted("a", restart=restart),), {"a": ended}, 100.0)
    assert [action.verb for action in actions] == ([verb] if verb else [])


def test_gives_up_after_too_many_failures_in_a_row():
    ended = Observed(phase="exited", exit_code=1, failures=3)
    (action,) = plan((Wanted("a", restart="always", max_failures=3),), {"a": ended}, 1e6)
    assert action.verb == "give_up"
    assert "exit code 1" in action.reason


@pytest.mark.parametrize(
    ("code", "was_healthy", "verb"), [(2, False, "give_up"), (2, True, "start"), (1, False, "start")]
)
def test_gives_up_at_once_on_what_cannot_use_its_configuration(code, was_healthy, verb):
    ended = Observed(phase="exited", exit_code=code, failures=1, healthy_since=5.0 if was_healthy else None)
    (action,) = plan((Wanted("a", restart="always"),), {"a": ended}, 100.0)
    assert action.verb == verb
    assert f"exit code {code}" in action.reason
    assert plan((Wanted("a", restart="no"),), {"a": ended}, 100.0) == ()


def test_a_frozen_service_is_ended_when_it_may_be_restarted():
    frozen = replace(HEALTHY, healthy=False, unhealthy_since=9.0)
    (action,) = plan((Wanted("a", restart="on-failure"),), {"a": frozen}, 10.0)
    assert action.verb == "stop"
    (action,) = plan((Wanted("a", restart="no"),), {"a": frozen}, 10.0)
    assert action.verb == "wait"


def test_a_service_that_never_becomes_healthy_is_ended():
    wanted = (Wanted("a", restart="always", start_period_s=5.0),)
    assert plan(wanted, {"a": RUNNING}, 4.9)[0].verb == "wait"
    assert plan(wanted, {"a": RUNNING}, 5.1)[0].verb == "stop"


@given(st.integers(1, 200))
def test_back_off_grows_up_to_its_bound(failures):
    assert backoff_s(failures) <= backoff_s(failures + 1) <= BACKOFF_MAX_S


def test_failures_are_forgotten_after_a_stable_time():
    state = replace(HEALTHY, failures=5)
    assert failures_after(state, 1.0 + STABLE_S) == 1
    assert failures_after(state, 1.5) == 6
