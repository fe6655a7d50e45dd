"""Audit of a recorded walk: the margin that each `state/stability` claims, against proofs from the recorded samples.

The contacts are computed anew from recorded joints, stance and gravity. The solver of the stability service proposes
forces and twists for them, and `proof.py`, which uses no solver, checks what they prove.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.record.recording import open_readable
from surefoot.record.robots import robot_of
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions
from surefoot.schemas.stability import Contact, RegionRequest, StabilityStatus
from surefoot.schemas.topics import HW_JOINTS, STATE_GAIT, STATE_STABILITY, STATE_VELOCITY
from surefoot.services.stability.answers import region_reply

from .proof import bounds, holds, inside

ALLOWED_M = 2e-3
"""Difference between a claimed margin and a proved bound, m, above which the claim counts as contradicted: twice the
tolerance of the stability service's regions."""
DIRECTIONS = 32
"""Number of horizontal directions, evenly spaced, in which proofs of a margin are searched."""


@dataclass(frozen=True)
class Claim:
    """Stability margin in one `state/stability` message, with the bounds proved for it."""

    tick: int
    step: int
    """Number of steps that the walker had taken at the time of the message."""
    claimed: float
    """Stability margin of the planned CoM in the message, m."""
    least: float
    """Lower bound of the margin, m, proved by contact forces; -inf = no bound was proved."""
    most: float
    """Upper bound of the margin, m, proved by twists of the robot; inf = no bound was proved."""

    @property
    def contradicted(self) -> bool:
        """True if the claimed margin is above `most` or below `least` by more than `ALLOWED_M`, else False."""
        return self.claimed > self.most + ALLOWED_M or self.claimed < self.least - ALLOWED_M

    @property
    def proved(self) -> bool:
        """True if a bound (`least`; `most` of a negative margin) confirms the claim within `ALLOWED_M`, else False."""
        if self.claimed < 0.0:
            return self.most <= self.claimed + ALLOWED_M and not self.contradicted
        return self.least >= self.claimed - ALLOWED_M and not self.contradicted


@dataclass(frozen=True)
class Audit:
    """Result of an audit of a recorded walk: claimed margins with proved bounds, number of messages not checked."""

    robot: str
    claims: tuple[Claim, ...]
    unchecked: int
    """Number of `state/stability` messages not checked: without a margin, or without the joint and gravity samples."""
    notes: tuple[str, ...] = ()
    """Remarks on the reading of the recording, e.g. parts that could not be read."""

    @property
    def steps(self) -> int:
        """Number of steps of the walk in which the stability service claimed a margin."""
        return len({claim.step for claim in self.claims})

    @property
    def contradicted(self) -> tuple[Claim, ...]:
        """Claimed margins that a proof contradicts."""
        return tuple(claim for claim in self.claims if claim.contradicted)


def audit(path: Path, progress: Callable[[float], None] = lambda share: None) -> Audit:
    """Check every stability margin that a recording claims against proved bounds, and return the audit.

    Args:
        path: recording (MCAP).
        progress: called with the share of the messages that has been checked, 0 to 1.

    Raises:
        SurefootError: the recording cannot be read, names no robot, or has no `state/stability`.
    """
    recording = open_readable(path)
    robot = robot_of(recording)
    joints: dict[int, Any] = {}
    up: dict[int, Any] = {}
    step: dict[int, int] = {}
    claiming: list[StabilityStatus] = []
    keys = (HW_JOINTS.key, STATE_VELOCITY.key, STATE_GAIT.key, STATE_STABILITY.key)
    for item in recording.messages(keys):
        message: Any = item.message()
        match item.key:
            case HW_JOINTS.key:
                if len(message.position) != robot.nj:
                    text = f"{path} has {len(message.position)} joints, {robot.name} has {robot.nj}"
                    raise SurefootError("invalid", text, "robot")
                joints[message.stamp_ns] = message
            case STATE_VELOCITY.key:
                up[message.tick] = message.g_up
            case STATE_GAIT.key:
                step[message.tick] = message.steps
            case _:
                claiming.append(message)
    claims: list[Claim | None] = []
    for status in claiming:
        claims.append(_claim(robot, status, joints, up, step))
        progress(len(claims) / len(claiming))
    found = tuple(claim for claim in claims if claim is not None)
    if not claiming:
        raise SurefootError("invalid", f"{path} has no {STATE_STABILITY.key}: nothing is claimed", "recording")
    return Audit(robot.name, found, len(claims) - len(found), recording.notes)


def _claim(
    robot: Robot, status: StabilityStatus, joints: dict[int, Any], up: dict[int, Any], step: dict[int, int]
) -> Claim | None:
    sample, gravity = joints.get(status.stamp_ns), _latest(up, status.tick)
    if status.margin_planned is None or sample is None or gravity is None:
        return None
    points, centre = level(robot, np.array(sample.position), np.array(gravity), np.array(status.stance, dtype=bool))
    least, most = proved(robot, points, status.mu, centre)
    return Claim(status.tick, _latest(step, status.tick) or 0, status.margin_planned, least, most)


def _latest(known: dict[int, Any], tick: int) -> Any:
    """Return the value of a control tick in `known`, else the latest of the 19 ticks before; None = there is none."""
    return next((known[t] for t in range(tick, max(-1, tick - 20), -1) if t in known), None)


def level(robot: Robot, q: Array, g_up: Array, stance: Any) -> tuple[Array, Array]:
    """Return contact points of standing feet (n, 3) and CoM (2,), m, in the level frame (z up, x along the heading).

    Args:
        q: joint angles, (nj,) rad.
        g_up: upward specific force at rest, base_link, (3,) m/s2.
        stance: True for each foot that stands, (L,).
    """
    up = g_up / np.sqrt((g_up**2).sum())
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    ahead /= np.sqrt((ahead**2).sum())
    rot = np.array([ahead, np.cross(up, ahead), up])  # rot_level_from_base
    points = (rot[None] * foot_positions(robot.model, q)[stance][:, None, :]).sum(axis=2)
    points[:, 2] -= robot.foot_radii[stance]
    return points, (rot[:2] * com(robot.model, q)).sum(axis=1)


def proved(robot: Robot, points: Array, mu: float, centre: Array) -> tuple[float, float]:
    """Return lower and upper bound, m, proved for the margin of a CoM (2,) m over contacts (n, 3) m on level ground.

    Returns:
        The two bounds, m; -inf or inf = no proof of it was found.
    """
    normals = np.tile((0.0, 0.0, 1.0), (len(points), 1))
    contacts = tuple(Contact(position=(x, y, z), normal=(0.0, 0.0, 1.0), mu=mu) for x, y, z in points.tolist())
    reply = region_reply(RegionRequest(contacts=contacts, directions=DIRECTIONS, certificates=True), robot)
    held: list[Array] = []
    most = np.inf
    for support in reply.support:
        direction = np.array(support.direction)
        if support.forces is not None and support.point is not None:
            point = np.array(support.point)
            if holds(points, normals, mu, np.array(support.forces), point):
                held.append(point)
        if support.certificate is not None:
            height = bounds(points, normals, mu, np.array(support.certificate), direction)
            most = min(most, height - float((direction * centre).sum()))
    return inside(held, centre), float(most)
