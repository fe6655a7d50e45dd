"""Scenarios unfold by the ticks: orders come early enough, once, and the end is found."""

from types import SimpleNamespace

import pytest

from surefoot.lockstep.leader import WINDOW_TICKS
from surefoot.schemas.topics import CMD_WALK, SIM_PAUSE, SIM_PUSH
from surefoot.services.supervisor.scenarios.director import HORIZON_TICKS, LEAD_TICKS, TRIES, Director
from surefoot.services.supervisor.scenarios.scenario import parse_scenario

WALK = """
description = "walk"
settle_s = 0.1
[[step]]
when = "ready"
do = "walk"
distance = 1.0
[[step]]
when = "walk_done"
after_s = 0.5
do = "turn"
angle = 1.0
"""


def gait(state="standing", walk_id=0, remaining=0.0, reason=""):
    return SimpleNamespace(state=state, walk_id=walk_id, remaining=remaining, reason=reason)


def ordered(limits="", **extra):
    """A director of the walk, and its first order."""
    director = Director(parse_scenario(WALK + limits))
    (order,) = director.on_tick(0, gait(), **extra)
    return director, order


def accepted():
    """A director whose first order was accepted as walk 1, and the tick of that order."""
    director, order = ordered()
    director.answered(order, SimpleNamespace(accepted=True, id=1, reason=""))
    return director, order.request.at_tick


class Walker:
    """Obeys at the tick of its order, walks for 20 ticks."""

    def __init__(self, director, ready_at=30):
        self.director = director
        self.ready_at = ready_at
        self.id = 0
        self.until = -1
        self.plan = None
        self.sent = []
        self.tick = -1

    def run(self, ticks, **extra):
        for _ in range(ticks):
            self.tick += 1
            if self.plan and self.tick >= self.plan[0]:
                self.id, self.until, self.plan = self.plan[1], self.tick + 20, None
            state = "waiting" if self.tick < self.ready_at else "walking" if self.tick < self.until else "standing"
            for order in self.director.on_tick(self.tick, gait(state, self.id, 0.4), **extra):
                self.sent.append((self.tick, order))
                assert order.request is None or order.request.at_tick >= self.tick + LEAD_TICKS
                if order.query is CMD_WALK:
                    self.plan = (order.request.at_tick, self.id + 1)
                    self.director.answered(order, SimpleNamespace(accepted=True, id=self.id + 1, reason=""))
                elif order.query is not None:
                    self.director.answered(order, SimpleNamespace(accepted=True, tick=order.request.at_tick, reason=""))

    def told(self):
        return [(tick, order.request.at_tick, order.query.key) for tick, order in self.sent]


def test_orders_reach_everybody_before_their_tick():
    assert LEAD_TICKS > WINDOW_TICKS


def test_waits_for_moments_and_ends():
    director = Director(parse_scenario(WALK))
    walker = Walker(director)
    walker.run(300)
    (walk, turn, end) = walker.told()
    assert walk == (30, 30 + LEAD_TICKS, "cmd/walk")
    done = walk[1] + 20
    assert turn == (done + 50 - HORIZON_TICKS, done + 50, "cmd/walk")
    assert end[2] == SIM_PAUSE.key
    assert walker.sent[-1][1].request.end
    assert director.ended
    assert not director.problems
    assert director.unfinished() == ()


def test_the_same_ticks_give_the_same_orders():
    walkers = [Walker(Director(parse_scenario(WALK))) for _ in range(2)]
    for walker in walkers:
        walker.run(300)
    assert walkers[0].told() == walkers[1].told()


def test_timed_steps_come_in_their_tick():
    text = 'description = "push"\n[[step]]\nat_tick = 40\ndo = "push"\nforce = [1.0, 0.0, 0.0]\nduration = 0.3\n'
    walker = Walker(Director(parse_scenario(text)))
    walker.run(200)
    push, end = walker.told()
    assert push == (40 - HORIZON_TICKS, 40, SIM_PUSH.key)
    assert end[1] >= 40 + 30 + 50


def test_a_kill_names_its_service():
    walker = Walker(
        Director(parse_scenario('description = "x"\n[[step]]\nat_tick = 20\ndo = "kill"\nservice = "walker"'))
    )
    walker.run(22)
    assert [(tick, order.kill) for tick, order in walker.sent] == [(20, "walker")]


def test_a_refused_command_is_a_problem_and_ends_the_run():
    director, order = ordered()
    director.answered(order, SimpleNamespace(accepted=False, id=0, reason="not initialised"))
    assert "not initialised" in director.problems[0]
    assert any(order.query is SIM_PAUSE for tick in range(1, 100) for order in director.on_tick(tick, gait()))


def test_no_reply_is_a_problem():
    director, order = ordered()
    director.failed(order, "timeout", "it did not answer")
    assert "it did not answer" in director.problems[0]


def test_an_order_that_reaches_no_service_is_sent_again_once_its_tick_has_passed():
    director, order = ordered()
    director.failed(order, "absent", "no service answers")
    assert director.on_tick(order.request.at_tick - 1, gait()) == []
    (again,) = director.on_tick(order.request.at_tick, gait())
    assert again.request.at_tick == order.request.at_tick + 2 * LEAD_TICKS
    for _ in range(TRIES - 1):
        assert not director.problems
        director.failed(again, "absent", "no service answers")
        (again,) = director.on_tick(again.request.at_tick, gait()) or (again,)
    assert "no service answers" in director.problems[0]


def test_an_order_that_came_too_late_is_sent_again_with_more_lead():
    director, order = ordered()
    sent, tick = [order.request.at_tick], 0
    while not director.problems:
        director.failed(order, "late", "at_tick has passed")
        if director.problems:
            break
        assert "came too late" in director.unfinished()[0]
        tick += 10
        (order,) = director.on_tick(tick, gait())
        assert order.walking
        sent.append(order.request.at_tick - tick)
    assert sent == [LEAD_TICKS * 2**n for n in range(TRIES)]
    assert len(director.notes) == TRIES - 1
    assert "at_tick has passed" in director.problems[0]


def test_an_order_that_came_too_late_once_is_no_problem():
    director, order = ordered()
    director.failed(order, "late", "at_tick has passed")
    walker = Walker(director, ready_at=0)
    walker.tick = 9
    walker.run(300)
    assert [key for _, _, key in walker.told()] == ["cmd/walk", "cmd/walk", "sim/pause"]
    assert director.ended
    assert not director.problems
    assert director.unfinished() == ()


def test_an_end_that_came_too_late_is_sent_again():
    director, end = ordered("[limits]\nno_fall = true\n", fallen=True)
    director.failed(end, "late", "at_tick has passed")
    (again,) = director.on_tick(10, gait(), fallen=True)
    assert again.query is SIM_PAUSE
    assert again.request.end
    assert again.request.at_tick > 10 + LEAD_TICKS
    assert not director.on_tick(20, gait(), fallen=True)


def test_a_walker_that_gives_up_is_a_problem():
    director, _ = accepted()
    director.on_tick(20, gait("walking", 1, 0.6))
    director.on_tick(21, gait("refused", 1, 0.6, "no foothold"))
    assert "no foothold" in director.problems[0]


def test_a_fall_ends_the_run_only_where_it_is_forbidden():
    careless, careful = (Director(parse_scenario(WALK + limits)) for limits in ("", "[limits]\nno_fall = true\n"))
    assert not careless.on_tick(0, None, fallen=True)
    (order,) = careful.on_tick(0, None, fallen=True)
    assert order.query is SIM_PAUSE
    assert not careful.on_tick(1, gait())


def test_a_restarted_walker_is_ordered_the_rest():
    director, begin = accepted()
    director.on_tick(begin + 5, gait("walking", 1, 0.35))
    assert director.on_tick(begin + 10, gait("recovering", 0)) == []
    (again,) = director.on_tick(begin + 20, gait("standing", 0))
    assert again.request.distance == pytest.approx(0.35)
    assert again.request.at_tick == begin + 20 + LEAD_TICKS
    assert director.notes
    director.answered(again, SimpleNamespace(accepted=True, id=1, reason=""))
    assert director.on_tick(31, gait("standing", 0)) == []


def test_a_walker_restarted_before_its_walk_began_is_ordered_the_whole():
    director, begin = accepted()
    assert director.on_tick(begin + 5, gait("recovering", 0)) == []
    assert director.on_tick(begin + 30, gait("recovering", 0)) == []
    (again,) = director.on_tick(begin + 40, gait("standing", 0))
    assert again.request.distance == 1.0
    assert again.walking


def test_a_walk_that_ends_after_its_gait_came_late_is_not_ordered_again():
    director, begin = accepted()
    assert director.on_tick(begin + 30, gait("recovering", 0)) == []
    assert director.on_tick(begin + 40, gait("walking", 1, 0.1)) == []
    orders = director.on_tick(begin + 90, gait("standing", 1))
    assert all(order.request.action == "turn" for order in orders)
    assert not director.problems


def test_what_is_left_undone_is_reported():
    director, _ = accepted()
    assert len(director.unfinished()) == 2
