"""Conversion between messages on the bus and the inputs and outputs of gaits."""

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.lockstep.join import TickInputs
from surefoot.schemas.state import GaitState, Odometry, VelocityEstimate
from surefoot.schemas.terrain import ElevationMap, HeightMapMessage
from surefoot.schemas.topics import HW_CONTACTS, HW_JOINTS, STATE_ELEVATION, STATE_STABILITY, TERRAIN_MAP

from .interface import WalkerInputs, WalkerOutputs
from .orders import TakenOrder


def walker_inputs(inputs: TickInputs, estimate: tuple[VelocityEstimate, Odometry] | None) -> WalkerInputs:
    """Return the inputs of a gait in a tick, from the messages of the tick.

    Args:
        inputs: messages of the tick.
        estimate: newest velocity and odometry, whose age the gait checks; None = none came yet.
    """
    velocity, odometry = estimate or (None, None)
    joints, contacts = inputs.get(HW_JOINTS), inputs.get(HW_CONTACTS)
    stability = inputs.get(STATE_STABILITY)
    return WalkerInputs(
        stamp=inputs.tick.stamp_ns * 1e-9,
        roll=velocity.roll if velocity else 0.0,
        pitch=velocity.pitch if velocity else 0.0,
        rate=velocity.angular_velocity if velocity else (0.0, 0.0, 0.0),
        x=odometry.position[0] if odometry else 0.0,
        y=odometry.position[1] if odometry else 0.0,
        yaw=odometry.yaw if odometry else 0.0,
        estimate_stamp=velocity.stamp_ns * 1e-9 if velocity else -1.0,
        initialised=velocity.initialised if velocity else False,
        joints=None if joints is None else np.array(joints.position),
        contacts=None if contacts is None else np.array([any(foot) for foot in contacts.touch]),
        margin=None if stability is None else stability.margin_planned,
    )


def newest_map(inputs: TickInputs, known: object) -> HeightMapMessage | ElevationMap | None:
    """Return the map of a tick, None if none came; only the robot's own map if that `known` before is its own.

    The robot's own map is an elevation map that it measures; the other one comes with the terrain.
    """
    own = inputs.get(STATE_ELEVATION)
    return own if own is not None or isinstance(known, ElevationMap) else inputs.get(TERRAIN_MAP)


def heights_of(message: HeightMapMessage | ElevationMap) -> HeightMap:
    """Return the height map that a message holds (raises HeightMapError)."""
    if isinstance(message, ElevationMap):
        return HeightMap.from_base64(message.model_dump(), message.heights)
    return HeightMap.from_wire(message.model_dump(), message.data)


def gait_message(out: WalkerOutputs, degraded: str, order: TakenOrder, navigated: bool) -> GaitState:
    """Return the outputs of a gait in a tick as the message `state/gait`.

    Args:
        out: outputs of the gait.
        degraded: reason in words that takes the place of the gait's own; empty = none.
        order: the navigator's last order.
        navigated: True if a navigator gives orders: the time until the end of the walk is published.
    """
    return GaitState(
        walk_id=out.walk_id,
        state=out.state,
        phase=min(1.0, max(0.0, out.phase)),
        stance=tuple(out.stance.tolist()),
        footholds=tuple(map(tuple, out.footholds.tolist())),
        foothold_status=out.foothold_status,
        trunk_height=out.trunk_height,
        remaining=out.remaining,
        margin=out.margin,
        reason=degraded or out.reason,
        steps=out.steps,
        order=order.number,
        order_refused=order.refused,
        ends_in_s=out.ends_in_s if navigated else None,
    )
