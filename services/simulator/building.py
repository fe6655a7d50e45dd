"""Construction of a world from a reset request, with the latched messages that describe its ground."""

from typing import Any, NamedTuple

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMapError
from surefoot.robot.description import Robot
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.terrain import HeightMapMessage, LandmarkMap
from surefoot.schemas.topics import Topic

from .ground.terrain import TerrainError, observed_map
from .messages import lacking, landmark_message, map_message
from .physics.model import Physics
from .physics.perturb import find_ground, perturbation
from .sensors.sight import Floor
from .world import PhysicsWorld, WorldConfig, WorldError


class BuiltWorld(NamedTuple):
    """Simulated world, with the request it was built from and the latched messages about its ground."""

    request: ResetRequest
    """Request that the world was built from."""
    world: PhysicsWorld
    heights: HeightMapMessage | None
    """Height map that is sent to the robot; None = it gets none."""
    landmarks: LandmarkMap | None
    """Landmarks on the floor that the robot's camera recognises; None = the robot has no such camera."""
    lacking: tuple[Topic[Any], ...]
    """Topics that this robot never publishes, for want of a sensor or map."""


def build_world(robot: Robot, request: ResetRequest) -> BuiltWorld:
    """Return the world that a request describes, with the messages about its ground.

    Raises:
        Refusal: code `invalid`; the field of the request that cannot be fulfilled.
    """
    w = request.world
    try:
        seed = request.seed if w.terrain_seed is None else w.terrain_seed
        terrain = find_ground(w.terrain, seed, w.amplitude)
        config = WorldConfig(
            physics=Physics() if w.friction is None else Physics(friction=w.friction),
            perturbation=perturbation(w.perturbation, request.seed, robot.nj, robot.kind),
            imu_profile=w.imu_profile,
            torque_per_ampere=w.torque_per_ampere,
            floor=Floor(
                w.landmarks,
                w.goal,
                w.copied_landmarks,
                w.copies,
                w.texture,
                w.texture_width,
                w.texture_seed,
                w.light,
                w.image_format,
            ),
            camera=w.camera,
            depth_camera=w.depth_camera,
            start=(0.0, 0.0, 0.0) if w.start is None else w.start,
            drift=w.drift,
            obstacles=w.obstacles,
        )
        world = PhysicsWorld(robot, terrain, request.seed, config)
        heights = None if w.map_profile == "none" else observed_map(terrain, w.map_profile, request.seed)
    except (TerrainError, WorldError, HeightMapError) as error:
        field = "start" if error.field == "pose" else error.field
        raise Refusal("invalid", str(error), f"world.{field}") from None
    given = None
    if heights is not None:
        given = map_message(heights.with_z(heights.z, version=1), terrain, w.map_profile)
    marks = None if world.sight is None else world.sight.landmarks
    return BuiltWorld(
        request=request,
        world=world,
        heights=given,
        landmarks=None if marks is None else landmark_message(marks, request.seed),
        lacking=lacking(world.sight, given),
    )
