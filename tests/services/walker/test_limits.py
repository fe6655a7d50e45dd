"""Checks of commands and orders one by one: each refuses what it is for, at its very limit."""

import math
from base64 import b64encode
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap
from surefoot.lockstep.join import TickInputs
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.hw import Tick
from surefoot.schemas.navigation import MotionOrder
from surefoot.schemas.terrain import ElevationMap, HeightMapMessage
from surefoot.schemas.topics import STATE_ELEVATION, TERRAIN_MAP
from surefoot.services.walker.commander import Commander
from surefoot.services.walker.commands import Abilities, ArcLimits, refusal_of
from surefoot.services.walker.interface import CommandReply, MotionCommand, refused
from surefoot.services.walker.memory import MemoryFile, WalkMemory
from surefoot.services.walker.messages import heights_of, newest_map
from surefoot.services.walker.orders import TakenOrder

LEGGED = Abilities(("tripod", "wave"), 0.2, shifts=True)
BIPED = Abilities(("walk",), 0.1, arcs=ArcLimits(0.04, 0.5, 0.2))


@pytest.mark.parametrize(
    ("can", "command", "state", "refusal"),
    [
        (LEGGED, MotionCommand("walk"), {}, None),
        (LEGGED, MotionCommand("walk", distance=math.nan), {}, ("bad_value", "distance")),
        (LEGGED, MotionCommand("walk", velocity=math.inf), {}, ("bad_value", "velocity")),
        (LEGGED, MotionCommand("turn", angle=-math.inf), {}, ("bad_value", "angle")),
        (LEGGED, MotionCommand("stand", shift=(0.01, 0.0)), {}, None),
        (BIPED, MotionCommand("stand", shift=(0.01, 0.0)), {}, ("unsupported", "shift")),
        (LEGGED, MotionCommand("walk", shift=(0.01, 0.0)), {}, ("bad_value", "shift")),
        (LEGGED, MotionCommand("walk", gait="wave"), {}, None),
        (LEGGED, MotionCommand("walk", gait="gallop"), {}, ("unknown_gait", "gait")),
        (LEGGED, MotionCommand("walk", gait="wave"), {"stepping_gait": "wave"}, None),
        (LEGGED, MotionCommand("walk"), {"stepping_gait": "wave"}, None),
        (LEGGED, MotionCommand("walk", gait="wave"), {"stepping_gait": "tripod"}, ("conflict", "gait")),
        (LEGGED, MotionCommand("stop"), {"fallen": True}, ("fallen", None)),
        (LEGGED, MotionCommand("stop"), {"calibrated": False}, None),
        (LEGGED, MotionCommand("stand"), {"calibrated": False}, None),
        (LEGGED, MotionCommand("stand", velocity=9.0), {}, None),
        (LEGGED, MotionCommand("walk"), {"calibrated": False}, ("not_initialised", None)),
        (LEGGED, MotionCommand("walk", angle=0.1), {"calibrated": False}, ("unsupported", "angle")),
        (LEGGED, MotionCommand("turn"), {}, ("missing_field", "angle")),
        (LEGGED, MotionCommand("turn", angle=1.0, velocity=0.1), {}, None),
        (BIPED, MotionCommand("turn", angle=1.0), {}, None),
        (BIPED, MotionCommand("turn", angle=1.0, velocity=0.1), {}, ("conflict", "velocity")),
        (BIPED, MotionCommand("turn", angle=1.0, distance=0.1), {}, ("conflict", "distance")),
        (LEGGED, MotionCommand("walk", velocity=-0.2), {}, None),
        (LEGGED, MotionCommand("walk", velocity=math.nextafter(0.2, 1.0)), {}, ("too_fast", "velocity")),
        (LEGGED, MotionCommand("walk", velocity=0.0), {}, ("too_fast", "velocity")),
        (BIPED, MotionCommand("walk", angle=0.1), {}, ("missing_field", "distance")),
        (BIPED, MotionCommand("walk", angle=0.1, distance=0.0), {}, ("missing_field", "distance")),
        (BIPED, MotionCommand("walk", angle=0.0, distance=0.1), {}, None),
        (BIPED, MotionCommand("walk", angle=0.99, distance=0.2), {}, None),
        (BIPED, MotionCommand("walk", angle=1.01, distance=0.2), {}, ("too_tight", "angle")),
        (BIPED, MotionCommand("walk", angle=1.01, distance=0.2, velocity=0.07), {}, None),
    ],
)
def test_a_command_is_taken_or_refused_by_name(can, command, state, refusal) -> None:
    found = refusal_of(command, can, **{"calibrated": True} | state)
    assert (None if found is None else (found.code, found.field)) == refusal


def order(number: int) -> MotionOrder:
    return MotionOrder(number=number, command=None if number == 0 else WalkCommand(action="walk"))


def test_an_order_is_taken_once_and_none_is_number_zero() -> None:
    taken = TakenOrder(4)
    assert taken.after(order(4)) is taken.after(order(0)) is taken
    assert taken.after(order(5)) == TakenOrder(5)
    assert taken.after(order(3)) == TakenOrder(3)


def test_a_walker_without_its_memory_takes_the_first_order_it_sees_as_an_old_one() -> None:
    taken = TakenOrder(known=False).after(order(7))
    assert taken.number == 0
    assert taken.after(order(7)) is taken
    assert taken.after(order(8)) == TakenOrder(8)


HEIGHTS = HeightMap(z=np.arange(12.0, dtype=np.float32).reshape(3, 4), cell=0.1, origin=(0.0, 0.0), version=2)
HEADER = {**HEIGHTS.header(), "origin": (0.0, 0.0)}
GIVEN = HeightMapMessage.model_construct(**HEADER, data=HEIGHTS.z.astype("<f4").tobytes())
OWN = ElevationMap.model_construct(**HEADER, heights=b64encode(HEIGHTS.z.astype("<f4").tobytes()).decode())


def test_of_two_maps_the_own_one_is_taken_and_then_no_other() -> None:
    def inputs(*maps: Any) -> TickInputs:
        keys = {ElevationMap: STATE_ELEVATION.key, HeightMapMessage: TERRAIN_MAP.key}
        return TickInputs(Tick.model_construct(tick=0, epoch=0), {keys[type(each)]: each for each in maps})

    assert newest_map(inputs(GIVEN), None) is GIVEN
    assert newest_map(inputs(GIVEN, OWN), None) is OWN
    assert newest_map(inputs(GIVEN), OWN) is None


def test_both_kinds_of_maps_carry_the_same_heights() -> None:
    for message in (GIVEN, OWN):
        found = heights_of(message)
        np.testing.assert_array_equal(found.z, HEIGHTS.z)
        assert (found.cell, found.origin, found.version) == (0.1, (0.0, 0.0), 2)


class Obedient:
    """A gait that obeys, but refuses turns."""

    def __init__(self) -> None:
        self.walk_id = 3
        self.obeyed: list[MotionCommand] = []
        self.resumed: list[WalkMemory] = []

    def never(self, command: MotionCommand) -> CommandReply | None:
        return refused("unsupported", "action", "no turns") if command.action == "turn" else None

    def command(self, command: MotionCommand) -> CommandReply:
        self.obeyed.append(command)
        return self.never(command) or CommandReply(True, self.walk_id)

    def kept(self) -> WalkMemory:
        return WalkMemory(self.walk_id, None, None, None)

    def resume(self, kept: WalkMemory) -> None:
        self.resumed.append(kept)


class Walker:
    """A commander with such a gait, and what it logs."""

    def __init__(self, path: Path | None = None, tick: int | None = 10) -> None:
        self.gait, self.logged = Obedient(), list[str]()
        self.does: Any = Commander(
            self.gait,  # type: ignore[arg-type]
            MemoryFile(None if path is None else str(path)),
            lambda level, text: self.logged.append(f"{level}: {text}"),
        )
        if tick is not None:
            self.does.begin(1, tick)

    def actions(self) -> list[str]:
        return [command.action for command in self.gait.obeyed]


@pytest.mark.parametrize("planned", [False, True])
def test_an_emergency_stop_refuses_all_but_stops(planned: bool) -> None:
    walker = Walker()
    if planned:
        assert walker.does.walk(WalkCommand(action="walk", at_tick=12)).accepted
    walker.does.stopped = "a button"
    assert walker.does.walk(WalkCommand(action="stop")).accepted
    reply = walker.does.walk(WalkCommand(action="walk", at_tick=13 if planned else None))
    assert (reply.accepted, reply.code) == (False, "stopped")
    assert "a button" in reply.reason
    walker.does.begin(1, 12)
    assert bool(walker.does.refused) == planned
    walker.does.begin(1, 13)
    assert walker.does.refused == ""
    assert walker.actions() == ["stop"]


def test_a_tick_that_has_passed_is_refused_and_the_next_one_taken() -> None:
    walker = Walker()
    with pytest.raises(Refusal, match="the next tick is 11") as late:
        walker.does.walk(WalkCommand(action="walk", at_tick=10))
    assert (late.value.code, late.value.field) == ("late", "at_tick")
    assert walker.does.walk(WalkCommand(action="walk", at_tick=11)).accepted
    assert walker.does.walk(WalkCommand(action="turn", at_tick=11)).code == "unsupported"
    assert walker.actions() == []
    walker.does.begin(1, 11)
    assert walker.actions() == ["walk"]


def test_an_order_is_obeyed_once_and_refused_where_it_cannot_be() -> None:
    walker = Walker(tick=0)
    walker.does.obey(order(0))
    walker.does.obey(order(1))
    walker.does.obey(order(1))
    assert walker.actions() == ["walk"]
    assert not walker.gait.obeyed[0].learn
    walker.does.obey(MotionOrder(number=2, command=None))
    assert walker.actions() == ["walk"]
    walker.does.obey(MotionOrder(number=3, command=WalkCommand(action="stop", at_tick=99)))
    assert (walker.does.order.number, walker.actions()) == (3, ["walk"])
    assert "at_tick" in walker.does.order.refused
    walker.does.obey(MotionOrder(number=4, command=WalkCommand(action="turn", angle=1.0)))
    assert walker.does.order.refused == "no turns"


def test_nothing_is_kept_before_the_first_tick_and_a_successor_takes_up_what_was(tmp_path: Path) -> None:
    path = tmp_path / "walker.json"
    first = Walker(path, tick=None)
    first.does.keep()
    assert not path.exists()
    first.does.begin(1, 0)
    first.does.obey(order(6))
    first.does.walk(WalkCommand(action="walk", at_tick=30))
    second = Walker(path, tick=20)
    assert (len(second.gait.resumed), second.does.order) == (1, TakenOrder(6))
    second.does.begin(1, 30)
    assert second.actions() == ["walk"]


def test_without_a_memory_a_successor_obeys_no_old_order(tmp_path: Path) -> None:
    walker = Walker(tmp_path / "walker.json", tick=20)
    assert walker.gait.resumed == []
    walker.does.obey(order(6))
    assert walker.actions() == []
    walker.does.obey(order(7))
    assert walker.actions() == ["walk"]
