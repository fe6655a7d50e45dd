"""Picture of a run at one time: the robot, its support, plans and estimates, from the latest messages.

Frame ``world`` is that of `sim/truth` where there is truth, else that of the odometry, z up, m.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import forward
from surefoot.services.footholds.learning.quality import slip_interval
from surefoot.services.stability.programs.contacts import ContactSet, StabilityError
from surefoot.services.stability.regions.equilibrium import least_forces
from surefoot.services.vision.messages import places_of
from surefoot.services.vision.recognise import RecogniseParams, gate_radius

from .shapes import DrawnGround, body_of, outline_of
from .styles import Item, Lasting

KEYS = (
    "sim/truth", "hw/joints", "hw/contacts", "state/velocity", "state/odometry", "state/gait", "state/stability",
    "footholds/chosen", "state/pose", "state/landmarks", "navigator/feedback", "terrain/map", "terrain/landmarks",
)  # fmt: skip
"""Topic keys whose messages update a scene; messages of other keys are ignored."""

POSTURE = ("sim/truth", "state/odometry", "hw/joints")
"""Topic keys that give the robot's pose and posture, the best first; a snapshot has the time of the one used."""
SAME_PLACE = 1e-3
"""Distance, m, up to which the gait's foothold counts as the one that the foothold service chose."""
FORCE_LENGTH = 1.2
"""Length of the arrow for a force equal to the robot's weight, as a share of the robot's extent."""
SLIPS = 0.002
"""Slide of a contact point during its stance, m, above which the foot is drawn as sliding."""
CONFIDENCE_95 = 2.4477
"""Half axis of the 95 % ellipse of a two-dimensional normal distribution, in standard deviations."""
ELLIPSE = np.linspace(0.0, 2.0 * math.pi, 25)[:-1]
LANDMARKS_DRAWN = 2000
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Snapshot:
    """Content of a scene at one simulated time, ready to be drawn.

    Attributes:
        time: simulated time, s.
        position, rot: pose of base_link in the world, (3,) m and (3, 3).
        joints: joint angles, (nj,) rad.
        link_rot, link_position: poses of the links in the world, (nl, 3, 3) and (nl, 3) m.
        points: points of the robot's body in the world, (n, 3) m.
        estimate: position (3,) m and rotation (3, 3) of base_link by the odometry, world; None without.
        items: items drawn besides the robot.
        values: numbers by name of `VALUES`; those that are unknown are left out.
        text: state of the gait, with its reason.
        fallen: True if the robot has fallen, else False.
    """

    time: float
    position: Array
    rot: Array
    joints: Array
    link_rot: Array
    link_position: Array
    points: Array
    estimate: tuple[Array, Array] | None
    items: tuple[Item, ...]
    values: dict[str, float]
    text: str = ""
    fallen: bool = False


@dataclass
class RobotScene:
    """Scene of one robot: keeps its latest messages, from which snapshots are made."""

    robot: Robot
    ground: DrawnGround | None = None
    marks: list[Lasting] = field(default_factory=list[Lasting])
    """Items that stay in all later snapshots: footprints of ended stances and landmarks."""
    epoch: int = -1
    strict: bool = False
    """True: `snapshot` raises the error of a message that cannot be read; False: such a message is left out."""

    def __post_init__(self) -> None:
        self.body = body_of(self.robot)
        self._latest: dict[str, Any] = {}
        self._world_from_odom: tuple[Array, Array] | None = None
        self._stances: tuple[int, ...] = ()
        self._chosen: dict[str, tuple[Any, str]] = {}
        self._waiting: dict[str, Callable[[], Any]] = {}
        self._outline = outline_of(self.robot.trunk.box)

    @property
    def true(self) -> bool:
        """True if the scene shows the driver's truth; False: what the robot senses and estimates."""
        return "sim/truth" in self._latest

    def latest(self, key: str) -> Any:
        """Return the message of a key of which the last snapshot was made; None without one."""
        return self._latest.get(key)

    def feed(self, key: str, read: Callable[[], Any]) -> None:
        """Set the latest message of a key; `read` decodes it, and is called only when a snapshot needs it."""
        if key in KEYS:
            self._waiting[key] = read

    def forget(self) -> None:
        """Drop all messages but the maps, for another system with the same keys, whose epochs start anew."""
        self._latest = {old: kept for old, kept in self._latest.items() if old.startswith("terrain/")}
        self.epoch, self._world_from_odom, self._stances, self._chosen = -1, None, (), {}
        self._waiting.clear()
        self.marks.clear()

    def snapshot(self) -> Snapshot | None:
        """Return a snapshot of the scene now; None without joint angles, or if they are those of another robot."""
        for key, read in self._take():
            self._accept(key, read)
        truth, joints = self._latest.get("sim/truth"), self._latest.get("hw/joints")
        angles = truth.joints if truth is not None else joints.position if joints is not None else ()
        if len(angles) != self.robot.nj:
            return None
        q = np.array(angles)
        rot_links, pos_links = forward(self.robot.model, q)
        local = pos_links[self.body.link] + np.einsum("nij,nj->ni", rot_links[self.body.link], self.body.local)
        position, rot = self._base(local)
        link_rot = np.einsum("ij,njk->nik", rot, rot_links)
        return self._shown(q, position, rot, link_rot, position + pos_links @ rot.T, position + local @ rot.T)

    def _take(self) -> list[tuple[str, Callable[[], Any]]]:
        """Return the messages that came since the last snapshot, the truth first: it begins an epoch."""
        waiting, self._waiting = self._waiting, {}
        return sorted(waiting.items(), key=lambda entry: KEYS.index(entry[0]))

    def _accept(self, key: str, read: Callable[[], Any]) -> None:
        try:
            message = read()
        except SurefootError:
            if self.strict:
                raise
            return  # of another version: the scene lacks it
        if message.epoch > self.epoch:
            self.epoch, self._world_from_odom, self._stances, self._chosen = message.epoch, None, (), {}
            self._latest = {old: kept for old, kept in self._latest.items() if old.startswith("terrain/")}
            self.marks.clear()
        if message.epoch < self.epoch and not key.startswith("terrain/"):
            return
        if key == "state/landmarks" and not message.fresh:
            return  # of no image: the last one stays
        self._latest[key] = message
        if key == "terrain/map":
            heights = np.frombuffer(message.data, dtype="<f4").reshape(message.rows, message.cols)
            self.ground = DrawnGround(heights.astype(float), message.cell, tuple(message.origin)).coarse()
        elif key == "terrain/landmarks" and message.count:
            rows = np.frombuffer(message.data, dtype="<f4").reshape(message.count, -1)[:LANDMARKS_DRAWN, :2]
            self.marks.append(Lasting(0.0, Item("landmark", self._on_ground(rows.astype(float)))))
        elif key == "footholds/chosen":
            self._chosen |= {leg.leg: (leg.foothold, _slip_text(leg)) for leg in message.legs}
        elif key == "sim/truth":
            self._ends_of_stances(message)

    def _ends_of_stances(self, truth: Any) -> None:
        if not len(truth.stances) == len(truth.stance_sliding) == len(truth.foot_position) == len(self.robot.legs):
            return  # of another robot, or of a driver that counts no stances
        before = self._stances or (0,) * len(truth.stances)
        for foot, (count, old) in enumerate(zip(truth.stances, before, strict=True)):
            if count > old:
                style = "footprint_slid" if truth.stance_sliding[foot] > SLIPS else "footprint"
                place = self._on_ground(np.array(truth.foot_position[foot])[None, :2])
                self.marks.append(Lasting(truth.stamp_ns * 1e-9, Item(style, place)))
        self._stances = tuple(truth.stances)

    def _on_ground(self, places: Array) -> Array:
        """Return points (n, 2) m, world, with the height of the ground below them added, (n, 3) m."""
        height = np.zeros(len(places)) if self.ground is None else self.ground.at(places)
        return np.column_stack((places, height))

    def _base(self, points: Array) -> tuple[Array, Array]:
        """Return the pose of base_link in the world: true, else estimated, else level with its lowest point at 0.

        Place (3,) m and rotation (3, 3); `points`: of the body in base_link, (n, 3) m.
        """
        truth, odometry = self._latest.get("sim/truth"), self._latest.get("state/odometry")
        if truth is not None:
            return np.array(truth.position), matrix_from_quat(np.array(truth.quat_wxyz))
        if odometry is not None:
            return np.array(odometry.position), matrix_from_quat(np.array(odometry.quat_wxyz))
        return np.array([0.0, 0.0, -float(points[: self.body.solid, 2].min())]), np.eye(3)

    def _odom(self) -> tuple[Array, Array]:
        """Return translation (3,) m and rotation (3, 3) of odom in the world, as they were when the estimate began."""
        truth, odometry = self._latest.get("sim/truth"), self._latest.get("state/odometry")
        if self._world_from_odom is None and truth is not None and odometry is not None and odometry.initialised:
            real = matrix_from_quat(np.array(truth.quat_wxyz))
            turn = np.eye(3)
            turn[:2, :2] = _turn(math.atan2(real[1, 0], real[0, 0]) - odometry.yaw)
            self._world_from_odom = np.array(truth.position) - product(turn, np.array(odometry.position)), turn
        return self._world_from_odom or (np.zeros(3), np.eye(3))

    def _shown(self, q: Array, position: Array, rot: Array, link_rot: Array, links: Array, points: Array) -> Snapshot:
        """Return the snapshot of a robot in this posture, and all drawn beside it; arguments as in `Snapshot`."""
        at, local = self.robot.model.foot_link, self.robot.model.foot_point
        feet = links[at] + np.add.reduce(link_rot[at] * local[:, None], axis=-1)
        estimate = self._estimate()
        items = [*self._support(position, rot, feet), *self._feet(feet), *self._navigation()]
        if estimate is not None and "sim/truth" in self._latest:
            items.append(Item("ghost", estimate[0] + self._outline @ estimate[1].T))
        truth, gait = self._latest.get("sim/truth"), self._latest.get("state/gait")
        text = "" if gait is None else f"{gait.state}: {gait.reason}" if gait.reason else gait.state
        feedback = self._latest.get("navigator/feedback")
        if feedback is not None and feedback.decision is not None:
            text += f", action {feedback.decision.action}"
        posture = next(m for key in POSTURE if (m := self._latest.get(key)) is not None)
        return Snapshot(
            posture.stamp_ns * 1e-9, position, rot, q, link_rot, links, points, estimate, tuple(items),
            self._values(rot, estimate), text, truth is not None and truth.fallen,
        )  # fmt: skip

    def _estimate(self) -> tuple[Array, Array] | None:
        odometry = self._latest.get("state/odometry")
        if odometry is None or not odometry.initialised:
            return None
        shift, turn = self._odom()
        found = matrix_from_quat(np.array(odometry.quat_wxyz))
        return shift + product(turn, np.array(odometry.position)), product(turn, found)

    def _support(self, position: Array, rot: Array, feet: Array) -> list[Item]:
        """Return support region and centres of mass, lifted from frame `level` to the feet (L, 3) m, in the world."""
        m = self._latest.get("state/stability")
        if m is None or len(m.stance) != len(feet):
            return []  # of another robot
        turn, stance = _turn(math.atan2(rot[1, 0], rot[0, 0])), np.array(m.stance)
        height = float((feet[stance, 2] if stance.any() else feet[:, 2]).mean()) - float(self.robot.foot_radius)

        def lifted(places: Any) -> Array:
            flat = np.array(places, dtype=float).reshape(-1, 2)
            points = np.full((len(flat), 3), height)
            points[:, :2] = position[:2] + flat @ turn.T
            return points

        items: list[Item] = []
        planned = None if m.com_planned is None else lifted(m.com_planned)
        if len(m.region) > 2:
            outside = m.margin_planned is not None and m.margin_planned < 0.0
            items.append(Item("unsafe" if outside else "region", lifted(m.region)))
            if not outside and planned is not None:
                touching = feet[stance]
                touching[:, 2] -= self.robot.foot_radii[stance]
                items += self._holding(touching, planned[0, :2], m.mu)
        if planned is not None:
            truth = self._latest.get("sim/truth")
            top = planned.copy()
            top[0, 2] = position[2] if truth is None else truth.com[2]
            plumb = np.concatenate((top, planned))
            items += [Item("plumb", plumb), Item("com_planned", top), Item("com_planned", planned)]
        if m.com_measured is not None:
            items.append(Item("com_measured", lifted(m.com_measured)))
        return items

    def _holding(self, touching: Array, com: Array, mu: float) -> list[Item]:
        """Return the forces that hold the CoM above a place (2,) m: why the place is in the region.

        They are those of `stability/equilibrium` for the contacts that the region was made of: points (n, 3) m on level
        ground, with one coefficient of friction.
        """
        n = len(touching)
        try:
            force = least_forces(ContactSet(touching, np.zeros((n, 3)) + UP, np.full(n, mu)), com)
        except StabilityError:  # no solution to full accuracy
            force = None
        if force is None:  # by the posture of another time than the margin's
            return []
        ends = np.repeat(touching, 2, axis=0)
        ends[1::2] += FORCE_LENGTH * self.body.extent * force
        return [Item("holding", ends)]

    def _feet(self, feet: Array) -> list[Item]:
        """Return forces, sliding feet and planned footholds of feet centred at (L, 3) m in the world."""
        truth, contacts = self._latest.get("sim/truth"), self._latest.get("hw/contacts")
        gait, velocity = self._latest.get("state/gait"), self._latest.get("state/velocity")
        items: list[Item] = []
        forces = truth.foot_force_n if truth is not None else contacts.normal_force_n if contacts is not None else ()
        for i, force in enumerate(forces[: len(feet)]):
            if force:
                tip = feet[i] + FORCE_LENGTH * self.body.extent * force / (GRAVITY * self.robot.mass) * UP
                items.append(Item("force", np.array([feet[i], tip])))
        sliding = truth.contact_sliding if truth is not None else ()
        slips = [way > SLIPS for way in sliding] or list(() if velocity is None else velocity.slipping)
        if any(slips) and len(slips) == len(feet):
            items.append(Item("slips", feet[np.array(slips)]))
        if gait is not None and len(gait.footholds) == len(gait.stance) == len(feet):
            shift, turn = self._odom()
            grounds = shift + np.array(gait.footholds) @ turn.T
            grounds[:, 2] -= self.robot.foot_radii
            for i, leg in enumerate(self.robot.legs):
                if not gait.stance[i]:
                    good = i >= len(gait.foothold_status) or gait.foothold_status[i] in ("ok", "nominal")
                    items.append(Item("foothold" if good else "foothold_bad", grounds[i : i + 1]))
                    items += self._expected(leg.name, gait.footholds[i], grounds[i : i + 1])
        return items

    def _expected(self, leg: str, foothold: Any, ground: Array) -> list[Item]:
        """Return a label with score and expected slip of a leg's foothold, if the foothold service chose it."""
        place, text = self._chosen.get(leg, (None, ""))
        if not text or math.dist(place[:2], foothold[:2]) > SAME_PLACE:
            return []
        return [Item("expected", ground, text)]

    def _navigation(self) -> list[Item]:
        """Return the drawn items of navigation: 95 % ellipse of the believed pose, matched landmarks, and the goal."""
        pose, feedback = self._latest.get("state/pose"), self._latest.get("navigator/feedback")
        items: list[Item] = []
        if pose is not None:
            cov = np.array(pose.covariance).reshape(3, 3)[:2, :2]
            values, axes = np.linalg.eigh(cov)
            circle = np.column_stack((np.cos(ELLIPSE), np.sin(ELLIPSE)))
            around = CONFIDENCE_95 * circle * np.sqrt(np.maximum(values, 0.0)) @ axes.T
            items.append(Item("belief", self._on_ground(np.array(pose.pose[:2]) + around)))
            items += self._matches(pose)
        if feedback is not None and feedback.goal_pose is not None:
            foot = self._on_ground(np.array(feedback.goal_pose)[None])[0]
            items.append(Item("goal", np.array([foot + self.body.extent * UP, foot])))
        return items

    def _matches(self, pose: Any) -> list[Item]:
        """Return the landmarks that vision recognised, by the believed pose, and the gate of the farthest."""
        seen = self._latest.get("state/landmarks")
        if seen is None or not seen.landmarks:
            return []
        x, y, yaw = pose.pose
        places = places_of(seen)
        reach = gate_radius(places, np.array(pose.covariance).reshape(3, 3), RecogniseParams())
        at, i = np.array([x, y]) + places @ _turn(yaw).T, int(reach.argmax())
        around = at[i] + reach[i] * np.column_stack((np.cos(ELLIPSE), np.sin(ELLIPSE)))
        gate = [] if seen.anywhere else [Item("gate", self._on_ground(np.vstack((around, around[:1]))))]
        return [Item("match", self._on_ground(at)), *gate]

    def _values(self, rot: Array, estimate: tuple[Array, Array] | None) -> dict[str, float]:
        """Return the known numbers of `VALUES` by name; `rot`: attitude, `estimate`: estimated pose of base_link."""
        found: dict[str, float | None] = {"tilt": math.degrees(math.acos(min(1.0, max(-1.0, float(rot[2, 2])))))}
        truth, velocity = self._latest.get("sim/truth"), self._latest.get("state/velocity")
        stability, gait = self._latest.get("state/stability"), self._latest.get("state/gait")
        if velocity is not None and velocity.initialised:
            found |= {"speed": velocity.velocity[0], "nis": velocity.nis}
        if truth is not None:
            found["speed_true"] = float(product(rot.T, np.array(truth.velocity))[0])
            if estimate is not None:
                found["drift"] = 100.0 * math.dist(estimate[0][:2], truth.position[:2])
        if stability is not None:
            planned, measured = stability.margin_planned, stability.margin_measured
            found["margin"] = None if planned is None else 1000.0 * planned
            found["margin_measured"] = None if measured is None else 1000.0 * measured
        if gait is not None:
            found["remaining"] = gait.remaining
        if (pose := self._latest.get("state/pose")) is not None:
            found["entropy"] = pose.entropy
        if (seen := self._latest.get("state/landmarks")) is not None:
            found |= {"features": seen.features, "matches": len(seen.landmarks)}
        return {name: value for name, value in found.items() if value is not None}


def _turn(yaw: float) -> Array:
    """Return the rotation (2, 2) of horizontal vectors by an angle, rad."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin], [sin, cos]])


def _slip_text(choice: Any) -> str:
    """Return score and expected slip, with its interval, of a chosen foothold; empty where the service gave none."""
    if choice.slip is None or choice.score is None or choice.foothold is None:
        return ""
    text = f"Q {choice.score:.3f}  slip {choice.slip:.3f}"
    if choice.spread is not None:
        (low,), (high,) = slip_interval(np.array([choice.slip]), np.array([choice.spread]))
        text += f" ({low:.3f} to {high:.3f})"
    return text
