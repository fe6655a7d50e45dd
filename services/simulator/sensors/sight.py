"""Sensors of the surroundings: camera, depth camera, ultrasound and bumpers, of robots that have them."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from surefoot.geometry.linear import product
from surefoot.robot.description import Robot
from surefoot.robot.profiles import CameraFile, read_profile
from surefoot.schemas.topics import TICK_NS, TICK_S

from ..ground.grid import random_stream
from ..ground.terrain import Terrain
from ..physics.addresses import Addresses
from ..physics.faults import IMAGE, FaultBank
from ..physics.samples import CameraFrame, ExactState, Reach
from .depth import DepthFrame, DepthSensor, read_depth_camera
from .floors import paint
from .images import ImageSensor, Optics, TakenImage
from .landmarks import (
    CameraPose,
    Landmarks,
    LandmarkSensor,
    camera_of,
    camera_pose,
    laid,
    link_of,
    scatter,
)
from .walls import bumped, echo, read_ranger

TICK_MS = TICK_NS // 1_000_000
FIELD = ((-5.0, -5.0), (5.0, 5.0))  # m, where an open floor has landmarks at least


@dataclass(frozen=True)
class Floor:
    """Settings of the floor: landmarks, marker of the goal, texture and light, format of the images."""

    landmarks: float = 60.0
    """Density of the landmarks on the floor, 1/m^2."""
    goal: tuple[float, float] | None = None
    """Position (x, y) of the marker of the goal, frame `map`, m; None = no marker."""
    copied: float = 0.0
    """Share of the landmarks that share their descriptor with other landmarks, 0..1."""
    copies: int = 10
    """Number of landmarks that share one descriptor."""
    texture: str | None = None
    """Name of a procedural texture, or path of a picture, for a camera that takes images; None = the camera recognises
    landmarks."""
    texture_width: float = 2.0
    """Width on the floor that a picture used as texture covers, m."""
    texture_seed: int | None = None
    """Seed of a procedural texture; None = the seed of the run."""
    light: float = 1.0
    """Factor on the brightness of the floor in images; 1 = normal light."""
    image_format: Literal["gray8", "jpeg"] = "gray8"
    """Format of the camera's images: raw 8-bit grey or JPEG."""


def sight_of(
    robot: Robot, seed: int, floor: Floor, terrain: Terrain, camera: str | None = None, depth_camera: str | None = None
) -> "Senses | None":
    """Return camera, depth camera and ranger of a robot; None if it has none of them.

    Args:
        robot: description, which names the robot's camera and ranger.
        seed: seed of the run.
        floor: landmarks and marker on it.
        terrain: the ground.
        camera: name of a profile; None = the robot's own.
        depth_camera: name of a profile; None = no such camera.

    Raises:
        RobotError: no such profile, or the robot has no link to carry it.
    """
    camera = robot.camera if camera is None else camera
    if camera is None and robot.ranger is None and depth_camera is None:
        return None
    return Senses(robot, seed, floor, terrain, camera, depth_camera)


class Senses:
    """Camera, depth camera, ultrasound and bumpers of one robot, with the samples of the present tick.

    Args:
        robot: description, which names the robot's camera, its ranger, or both.
        seed: seed of the run: where the landmarks are, what is recognised, noise.
        floor: landmarks, marker and texture on the floor.
        terrain: the ground: landmarks lie on its floor, on open ground as far as its map reaches, 10 x 10 m at least.
        camera: name of a profile; None = no camera.
        depth_camera: name of a profile; None = no such camera.

    Raises:
        RobotError: no such profile, or the robot has no link to carry it.
    """

    def __init__(
        self, robot: Robot, seed: int, floor: Floor, terrain: Terrain, camera: str | None, depth_camera: str | None
    ) -> None:
        self.robot = robot
        self.depth = None if depth_camera is None else DepthSensor(read_depth_camera(depth_camera), seed)
        self.depths: DepthFrame | None = None
        file = None if camera is None else read_profile(CameraFile, camera, "camera")[0]
        self.camera = None if file is None else camera_of(file)
        self.ranger = None if robot.ranger is None else read_ranger(robot.ranger)
        self.landmarks: Landmarks | None = None
        """Landmarks that the camera may recognise; None if there is no camera or it takes images."""
        self.eye: ImageSensor | None = None
        """Camera that takes images; None if the camera recognises landmarks or there is none."""
        self.image: TakenImage | None = None
        if self.camera is not None:
            link_of(robot, self.camera)
        if file is not None and floor.texture is not None:
            sown = seed if floor.texture_seed is None else floor.texture_seed
            texture = paint(terrain, floor.texture, floor.texture_width, floor.light, sown)
            self.eye = ImageSensor(Optics.of(file), texture, seed, floor.image_format)
        elif self.camera is not None:
            x0, y0, x1, y1 = terrain.map.bounds
            (a0, b0), (a1, b1) = FIELD
            field = scatter(seed, (min(a0, x0), min(b0, y0)), (max(a1, x1), max(b1, y1)), floor.landmarks)
            self.landmarks = laid(field, terrain, seed, floor.copied, floor.copies)
            self.sensor = LandmarkSensor(robot, self.camera, self.landmarks, seed, floor.goal)
        self.rng = random_stream(seed, "ranger")
        self.bump = np.zeros(robot.nlegs, dtype=np.bool_)
        self.before: CameraPose | None = None
        self.frame: CameraFrame | None = None
        self.reach: Reach | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors that the robot has, as faults use them."""
        there = (("landmarks", self.landmarks), ("range", self.ranger), (IMAGE, self.eye))
        return tuple(name for name, sensor in there if sensor is not None)

    def look(self, ticks: int, truth: Callable[[], ExactState], model: Any, data: Any, address: Addresses) -> None:
        """Sample the state at the end of a tick: set `frame`, `image`, `depths` and `reach` if due, else to None.

        Args:
            ticks: control ticks since the run began.
            truth: function that returns the exact state.
            model: MuJoCo model of the world.
            data: state of MuJoCo's physics.
            address: indices of the robot in it.
        """
        self.frame = self.reach = self.image = None
        self.depths = None if self.depth is None else self.depth.take(ticks, model, data, address.trunk)
        if self.eye is not None and self.camera is not None:
            exact = truth()
            now = camera_pose(self.robot, self.camera, exact.position, exact.quat_wxyz, exact.joints)
            self.image = self.eye.look(ticks, now)
        elif self.camera is not None:
            every = self.camera.period_ms // TICK_MS
            if (ticks + 1) % every == 0 or ticks % every == 0:
                exact = truth()
                now = camera_pose(self.robot, self.camera, exact.position, exact.quat_wxyz, exact.joints)
                if ticks % every == 0:
                    seen = self.sensor.look(self.before or now, now, TICK_S)
                    self.frame = CameraFrame(ticks // every, *seen)
                self.before = now
        if self.ranger is not None:
            self.bump |= bumped(data, address, self.robot.nlegs, self.ranger.bump_n)
            every = self.ranger.period_ms // TICK_MS
            if ticks % every == 0:
                self.reach = Reach(
                    ticks // every, self._distance(model, data, address.trunk), tuple(self.bump.tolist())
                )
                self.bump[:] = False

    def spoil(self, faults: FaultBank, tick: int) -> None:
        """Change the samples of this tick as the active faults require.

        Args:
            faults: faults of the run.
            tick: present tick of the world.
        """
        if self.eye is not None:
            self.image = self.eye.spoil(faults, tick, self.image)
        if self.frame is not None:
            marks, goal = faults.seen(tick, self.frame.landmarks, self.frame.goal, self.sensor.field.descriptor)
            x = faults.fail(tick, "landmarks", np.array([v for m in marks for v in (m.range, m.bearing)]))
            marks = [] if x is None else [
                m._replace(range=abs(float(r)), bearing=math.remainder(float(b), math.tau))
                for m, (r, b) in zip(marks, x.reshape(-1, 2), strict=True)
            ]  # fmt: skip
            self.frame = None if x is None else self.frame._replace(landmarks=marks, goal=goal)
        if self.reach is not None and self.ranger is not None:
            heard = faults.echo(tick, self.reach.distance, self.ranger.shortest)
            far = self.ranger.longest
            x = None if heard is None else faults.fail(tick, "range", np.array([far if heard[0] is None else heard[0]]))
            if x is None:
                self.reach = None
            elif heard is not None and (heard[0] is not None or x[0] != far):
                self.reach = self.reach._replace(distance=min(far, max(self.ranger.shortest, abs(float(x[0])))))

    def moved(self) -> None:
        """Forget the camera's motion after the robot was moved to another place, which would blur the next image."""
        self.before = None
        if self.eye is not None:
            self.eye.path.clear()

    def _distance(self, model: Any, data: Any, trunk: int) -> float | None:
        r = self.ranger
        assert r is not None
        base = data.xmat[trunk].reshape(3, 3)
        heading = math.atan2(base[1, 0], base[0, 0])
        found = echo(model, data, data.xpos[trunk] + product(base, r.position), heading, r.half_cone, r.longest)
        if found >= r.longest:
            return None
        measured = r.resolution * round((found + r.sigma * self.rng.standard_normal()) / r.resolution)
        return min(r.longest, max(r.shortest, measured))

    def state(self) -> dict[str, Any]:
        """Return random streams and the state between two samples, as plain JSON values."""
        before = None if self.before is None else [part.tolist() for part in self.before]
        camera = self.eye or (self.sensor if self.camera is not None else None)
        eye = {} if camera is None else {"camera": camera.state()}
        eye |= {} if self.depth is None else {"depth": self.depth.rng.bit_generator.state}
        return {"rng": self.rng.bit_generator.state, "bump": self.bump.tolist(), "before": before, **eye}

    def restore(self, state: dict[str, Any]) -> None:
        """Set everything that changes in a run to a `state` that was returned earlier; samples of its tick are lost."""
        self.rng.bit_generator.state = state["rng"]
        self.bump[:] = state["bump"]
        self.before = None if state["before"] is None else CameraPose(*(np.array(part) for part in state["before"]))
        camera = self.eye or (self.sensor if self.camera is not None else None)
        if camera is not None:
            camera.restore(state["camera"])
        if self.depth is not None:
            self.depth.rng.bit_generator.state = state["depth"]
        self.frame = self.reach = self.image = self.depths = None
