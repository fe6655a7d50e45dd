"""Checks of a world and of a gait before the services start: without them, an error shows only when all are up."""

from typing import TYPE_CHECKING

from surefoot.errors import ConfigError

if TYPE_CHECKING:
    from surefoot.robot.description import Robot
    from surefoot.schemas.sim import World
    from surefoot.services.supervisor.processes.compose import Compose


def check_system(compose: "Compose", world: "World", seed: int) -> None:
    """Check what the services of a system start with: the gait of a walker, the world of a simulator.

    Args:
        compose: the system.
        world: the world that its simulator is to make.
        seed: seed of the world.

    Raises:
        RobotError: a number of the robot's gait is unknown, missing or out of its range.
        ConfigError: the world cannot be made.
    """
    from surefoot.robot.reader import load_robot

    if "walker" in compose.services:
        check_gait(load_robot(compose.robot))
    if "simulator" in compose.services:
        check_world(world, seed)


def check_gait(robot: "Robot") -> None:
    """Check the numbers of a robot's gait; raise RobotError if one is unknown, missing or out of its range."""
    from surefoot.services.walker.biped.params import BipedParams
    from surefoot.services.walker.legged.params import WalkerParams

    (BipedParams if robot.kind == "biped" else WalkerParams).for_robot(robot)


def check_world(world: "World", seed: int) -> None:
    """Build the terrain of a world and look its sensors up, as a check; raise ConfigError if either is impossible."""
    from surefoot.geometry.heightmap import HeightMapError
    from surefoot.services.simulator.ground.terrain import TerrainError
    from surefoot.services.simulator.physics.perturb import find_ground

    _check_sensors(world)
    try:
        find_ground(world.terrain, seed if world.terrain_seed is None else world.terrain_seed, world.amplitude)
    except (TerrainError, HeightMapError) as error:
        raise ConfigError("invalid", f"{world.terrain}: {error}", "terrain") from None


def _check_sensors(world: "World") -> None:
    from surefoot.robot.description import RobotError
    from surefoot.services.simulator.physics.disturb import WorldError
    from surefoot.services.simulator.sensors.depth import read_depth_camera
    from surefoot.services.simulator.sensors.landmarks import read_camera
    from surefoot.services.simulator.sensors.suite import known_imu

    named = (world.camera, read_camera), (world.depth_camera, read_depth_camera), (world.imu_profile, known_imu)
    for name, read in named:
        try:
            if name is not None:
                read(name)
        except (RobotError, WorldError) as error:
            raise ConfigError("unknown_name", f"world.{error}", f"world.{error.field}") from None
