"""Obstacles that no map shows: boxes that stand or cross the floor, for a while or for the whole run.

They are bodies that no contact moves. All of their state is their places, which are part of the state of the physics:
a checkpoint contains them.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.schemas.sim import Obstacle
from surefoot.schemas.topics import TICK_S

from .addresses import Addresses
from .model import TERRAIN_BIT, Physics

AWAY = -50.0
"""z at which an obstacle is kept, far below the floor, while it is not present, m."""
UPRIGHT = 0.5
"""Magnitude of the z component of a contact's unit normal below which the contact is with a side or wall, not a top."""


class Obstacles:
    """Obstacles of one world: boxes that stand or cross the floor, which no contact moves.

    Args:
        spec: MuJoCo description of the world, before it is compiled; each obstacle becomes a body of it.
        boxes: place, size and movement of each obstacle.
        physics: contact settings.
    """

    def __init__(self, spec: Any, boxes: Sequence[Obstacle], physics: Physics) -> None:
        self._boxes = tuple(boxes)
        for i, box in enumerate(self._boxes):
            body = spec.worldbody.add_body(name=f"obstacle_{i}", pos=(*box.centre, AWAY), mocap=True)
            body.add_geom(
                name=f"terrain_obstacle_{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=(*box.half, 0.5 * box.height),
                contype=TERRAIN_BIT, conaffinity=0, condim=3, priority=1, friction=[physics.friction, 0.0, 0.0],
                solref=physics.solref, solimp=physics.solimp,
            )  # fmt: skip
        self._geoms: NDArray[np.int64] = np.zeros(0, dtype=np.int64)

    def find(self, model: Any) -> None:
        """Find the obstacles' geoms in the compiled model and keep their ids."""
        names = [f"terrain_obstacle_{i}" for i in range(len(self._boxes))]
        self._geoms = np.array([model.geom(name).id for name in names], dtype=np.int64)

    def move(self, data: Any, address: Addresses, tick: int) -> None:
        """Move every obstacle to its place in the tick that begins now, for the next physics step.

        Args:
            data: state of the physics.
            tick: control ticks since the reset.
        """
        now, robot = tick * TICK_S, data.xpos[address.trunk]
        for i, box in enumerate(self._boxes):
            place = data.mocap_pos[i]
            there = box.from_s <= now and (box.until_s is None or now < box.until_s)
            if there and place[2] < 0.0 and box.to is not None and box.from_s > 0.0:
                # as a person who steps out, but not into the robot
                there = math.dist(robot[:2], place[:2]) >= box.gives_way
            place[2] = 0.5 * box.height if there else AWAY
            if box.to is not None and place[2] > 0.0:
                self._walk(box, place, robot)

    def _walk(self, box: Obstacle, place: Array, robot: Array) -> None:
        """Move an obstacle at `place` by a tick towards its end, in place, unless it gives way to the robot ahead.

        `place`, `robot`: x, y, z in the world, (3,) m.
        """
        assert box.to is not None
        way_x, way_y = box.to[0] - float(place[0]), box.to[1] - float(place[1])
        left = math.sqrt(way_x * way_x + way_y * way_y)
        if left == 0.0:
            return
        off_x, off_y = float(robot[0] - place[0]), float(robot[1] - place[1])
        ahead = off_x * way_x + off_y * way_y > 0.0
        if ahead and off_x * off_x + off_y * off_y < box.gives_way * box.gives_way:
            return
        share = min(1.0, box.speed * TICK_S / left)
        place[0] += share * way_x
        place[1] += share * way_y

    def touched(self, data: Any) -> bool | None:
        """Return True if the robot pressed a side of an obstacle in the last physics step; None: there are none."""
        if not self._boxes:
            return None
        contact = data.contact
        sides = (np.abs(contact.frame[:, 2]) < UPRIGHT) & (contact.efc_address >= 0)
        return bool((np.isin(contact.geom, self._geoms).any(axis=1) & sides).any())
