"""Obstacles that no map shows: where they are, which echoes of them come, and that touching them is known."""

import math
from typing import Any

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import Obstacle, ResetRequest, World
from surefoot.services.simulator.building import build_world
from surefoot.services.simulator.messages import truth_message
from surefoot.services.simulator.sensors.walls import echo
from surefoot.services.simulator.world import PhysicsWorld, WorldError

NAO = load_robot("nao")
EYE, LONGEST = 0.3, 2.5


def world(*obstacles: Obstacle, terrain: str = "corridor") -> PhysicsWorld:
    request = ResetRequest(seed=3, world=World(terrain=terrain, obstacles=obstacles))
    return build_world(NAO, request).world


def ahead(made: PhysicsWorld, cone: float = 0.0) -> float:
    """Distance of the nearest thing ahead of the map's origin, m."""
    return echo(made.model, made.data, np.array([0.0, 0.0, EYE]), 0.0, cone, LONGEST)


def at(made: PhysicsWorld, which: int = 0) -> tuple[float, float, bool]:
    """Place of an obstacle, m, and whether it is there."""
    x, y, z = made.data.mocap_pos[which]
    return float(x), float(y), bool(z > 0.0)


def test_the_ranger_hears_a_box_that_the_map_does_not_show() -> None:
    box = Obstacle(centre=(1.2, 0.0), half=(0.2, 0.1))
    built = build_world(NAO, ResetRequest(seed=3, world=World(terrain="corridor", obstacles=(box,))))
    plain = build_world(NAO, ResetRequest(seed=3, world=World(terrain="corridor")))
    assert built.heights == plain.heights
    for one in (built.world, plain.world):
        one.step_tick()
        one.step_tick()
    assert ahead(built.world) == pytest.approx(1.0)
    assert ahead(plain.world) == LONGEST
    assert echo(built.world.model, built.world.data, np.array([0.0, 0.0, 0.7]), 0.0, 0.0, LONGEST) == LONGEST


def test_a_box_comes_and_goes_by_the_clock() -> None:
    made = world(Obstacle(centre=(1.0, 0.5), from_s=0.05, until_s=0.1))
    there = []
    for _ in range(15):
        made.step_tick()
        there.append(at(made)[2])
    assert there == [False] * 5 + [True] * 5 + [False] * 5


@pytest.mark.parametrize(("gives_way", "there"), [(0.35, True), (0.45, False)])
def test_a_box_that_moves_does_not_come_where_the_robot_is(gives_way: float, there: bool) -> None:
    made = world(
        Obstacle(centre=(0.0, 0.4), to=(0.0, 2.0), from_s=0.03, gives_way=gives_way),
        Obstacle(centre=(0.0, -0.4), from_s=0.03, gives_way=gives_way),  # as a door: it closes whoever stands there
    )
    for _ in range(10):
        made.step_tick()
    assert (at(made)[2], at(made, 1)[2]) == (there, True)


def test_a_box_crosses_once_at_its_speed() -> None:
    made = world(Obstacle(centre=(2.0, -0.8), to=(2.0, 0.7), speed=0.5, from_s=0.2))
    for _ in range(120):
        made.step_tick()
    assert at(made)[:2] == pytest.approx((2.0, -0.8 + 0.5 * 1.0), abs=1e-9)
    for _ in range(220):
        made.step_tick()
    assert at(made)[:2] == pytest.approx((2.0, 0.7), abs=1e-9)


@pytest.mark.parametrize(("gives_way", "nearest"), [(0.5, 0.5), (0.8, 0.8)])
def test_a_box_halts_before_the_robot_and_one_that_has_passed_goes_on(gives_way: float, nearest: float) -> None:
    comes = Obstacle(centre=(1.5, 0.0), to=(-0.8, 0.0), speed=1.0, gives_way=gives_way)
    leaves = Obstacle(centre=(0.4, 0.0), to=(0.9, 0.0), speed=1.0, gives_way=gives_way)
    made = world(comes, leaves)
    for _ in range(150):
        made.step_tick()
    robot = made.truth().position
    assert math.hypot(at(made)[0] - robot[0], at(made)[1] - robot[1]) == pytest.approx(nearest, abs=0.012)
    assert at(made, 1)[0] == pytest.approx(0.9)


@pytest.mark.parametrize(("gap", "touching"), [(-0.001, True), (0.02, False)])
def test_a_foot_that_presses_a_box_touches_it(gap: float, touching: bool) -> None:
    plain = world()
    front = max(float(plain.data.geom_xpos[g][0]) for g in plain.address.foot_geoms.ravel() if g >= 0)
    edge = front + NAO.legs[0].foot.radius + gap
    made = world(Obstacle(centre=(edge + 0.1, 0.0), half=(0.1, 0.3)))
    seen = []
    for _ in range(3):
        made.step_tick()
        seen.append(made.truth().touching)
    assert any(seen) == touching
    assert not made.truth().fallen


def test_a_world_without_obstacles_states_nothing_about_them() -> None:
    without, beside = world().truth(), world(Obstacle(centre=(3.0, 0.0))).truth()
    assert without.touching is None
    assert "touching" not in truth_message(without).model_dump_json()
    assert truth_message(beside).touching is False


def test_a_checkpoint_holds_the_places() -> None:
    made = world(Obstacle(centre=(2.0, -0.8), to=(2.0, 0.7)))
    for _ in range(50):
        made.step_tick()
    saved = made.checkpoint()

    def further() -> tuple[Any, ...]:
        for _ in range(30):
            made.step_tick()
        return (*at(made), *made.data.qpos)

    first = further()
    made.restore(saved)
    assert further() == first
    with pytest.raises(WorldError, match="checkpoint"):
        world(Obstacle(centre=(2.0, -0.8), to=(2.0, 0.6))).restore(saved)
