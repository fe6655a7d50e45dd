"""A navigator's orders on the bus: taken up in the tick after they were published, answered in state/gait."""

from typing import Any

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.lockstep.service import Service
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.navigation import MotionOrder
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.state import GaitState
from surefoot.schemas.topics import NAVIGATOR_ORDER, SIM_RESET, STATE_GAIT
from surefoot.services.estimator.service import SERVICE as ESTIMATOR
from surefoot.services.simulator.service import SERVICE as SIMULATOR
from surefoot.services.simulator.service import SimulatorConfig
from surefoot.services.walker.service import SERVICE as WALKER

ORDERED = 400  # tick
TICKS = 1000


class Navigator(Service[ServiceConfig]):
    """Orders a walk of 10 cm, and a turn as soon as that ends in 0.3 s."""

    name = "navigator"
    inputs = (STATE_GAIT,)
    outputs = (NAVIGATOR_ORDER,)

    def on_start(self) -> None:
        self.gaits: list[GaitState] = []
        self.order = MotionOrder(number=0)
        self.turned = -1

    def on_tick(self, inputs: TickInputs) -> None:
        gait = inputs.get(STATE_GAIT)
        assert gait is not None
        self.gaits.append(gait)
        if inputs.number == ORDERED:
            self.order = MotionOrder(number=1, command=WalkCommand(action="walk", distance=0.1))
        elif self.turned < 0 and gait.order == 1 and gait.ends_in_s is not None and gait.ends_in_s <= 0.3:
            self.order, self.turned = (
                MotionOrder(number=2, command=WalkCommand(action="turn", angle=0.4)),
                inputs.number,
            )
        self.publish(NAVIGATOR_ORDER, self.order.model_copy())


def test_orders_are_taken_up_in_the_next_tick_and_follow_each_other_without_a_halt() -> None:
    config: dict[str, Any] = {"robot": "nao"}
    navigator = Navigator(ServiceConfig(**config))
    simulator = SIMULATOR(SimulatorConfig(**config, autostart=False))
    others = [kind(kind.Config(**config)) for kind in (ESTIMATOR, WALKER)]
    system = LocalSystem([simulator, *others, navigator])
    try:
        expect = ("estimator", "walker", "navigator")
        system.bus.call(SIM_RESET, ResetRequest(expect=expect, max_ticks=TICKS))
        leader = simulator.node.leader
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
    finally:
        system.close()
    gaits = navigator.gaits
    assert [gait.tick for gait in gaits] == list(range(TICKS))
    assert (gaits[ORDERED].state, gaits[ORDERED].order) == ("standing", 0)
    assert (gaits[ORDERED + 1].state, gaits[ORDERED + 1].order, gaits[ORDERED + 1].walk_id) == ("walking", 1, 1)
    turned = navigator.turned
    assert (gaits[turned].order, gaits[turned + 1].order, gaits[turned + 1].state) == (1, 2, "turning")
    standing = next(gait.tick for gait in gaits[turned:] if gait.state == "standing")
    assert all(gait.state == "turning" for gait in gaits[turned + 1 : standing])
    assert gaits[standing].steps == 5  # two, two and the closing one
    assert not any(gait.order_refused for gait in gaits)
