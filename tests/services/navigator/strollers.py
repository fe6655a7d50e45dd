"""A made-up walker at the level of actions, for tests of the pilot: it obeys orders tick by tick, without legs."""

import math
from dataclasses import dataclass

from surefoot.services.navigator.goals import GaitView
from surefoot.services.navigator.pilot import Pilot

TICK_S = 0.01
STEPS_S, START_S, CLOSE_S = 1.8, 1.0, 0.9


@dataclass
class Stroller:
    """Walks, turns and stops exactly as ordered.

    Attributes:
        early: reports the end of an action ahead, as bipeds do; else only that it stands.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    early: bool = True
    order: int = 0
    walk_id: int = 0
    refused: str = ""
    halts: int = 0
    """Times it stood after the first order."""
    state: str = "standing"
    _left: float = 0.0
    _rate: tuple[float, float] = (0.0, 0.0)
    _wait: float = 0.0
    _closing: float = 0.0

    def view(self) -> GaitView:
        """Return what it publishes in this tick."""
        busy = self._left > 0.0
        ends_in = self._wait + self._left if busy and self.early else None
        return GaitView(self.state, self.walk_id, self.order, self.refused, ends_in)

    def take(self, pilot: Pilot) -> None:
        """Take up the pilot's order of the tick before."""
        if pilot.orders.number == self.order or pilot.orders.order is None:
            return
        self.order, self.walk_id = pilot.orders.number, self.walk_id + 1
        order = pilot.orders.order
        if order.action == "stop":
            self._left = 0.0
            self._closing = CLOSE_S if self.state != "standing" else 0.0
            return
        rest = self._left if self.state != "standing" else 0.0
        if self.state == "standing":
            self._wait = START_S
        forward, turn = order.distance or 0.0, order.angle or 0.0
        seconds = STEPS_S * max(1.0, abs(turn) / 0.41) if order.action == "turn" else STEPS_S
        if order.velocity is not None:
            seconds = abs(forward) / order.velocity
        total = rest + seconds
        self._rate = ((self._rate[0] * rest + forward) / total, (self._rate[1] * rest + turn) / total)
        self._left = total
        self.state = "turning" if order.action == "turn" else "walking"

    def tick(self) -> None:
        """Move for 10 ms."""
        if self._wait > 0.0:
            self._wait -= TICK_S
        elif self._left > 0.0:
            step = min(TICK_S, self._left)
            middle = self.yaw + 0.5 * self._rate[1] * step
            self.x += self._rate[0] * step * math.cos(middle)
            self.y += self._rate[0] * step * math.sin(middle)
            self.yaw += self._rate[1] * step
            self._left -= step
            if self._left <= 1e-9:
                self._left, self._closing = 0.0, CLOSE_S
        elif self._closing > 0.0:
            self._closing -= TICK_S
        elif self.state not in ("standing", "refused", "waiting"):
            self.state, self.halts = "standing", self.halts + 1
