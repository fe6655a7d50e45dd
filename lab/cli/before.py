"""Check of a simulated world before its services start: without it, an error shows only when all are up."""

from typing import TYPE_CHECKING

from surefoot.errors import ConfigError

if TYPE_CHECKING:
    from surefoot.schemas.sim import World


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
