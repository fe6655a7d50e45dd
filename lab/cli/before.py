"""Checks of a start before anything starts: the terrain and the environment's values."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from surefoot.errors import ConfigError

if TYPE_CHECKING:
    from surefoot.schemas.sim import World
    from surefoot.services.supervisor.processes.compose import Compose

SIMULATOR = "simulator"


def check_before(compose: "Compose", world: "World", seed: int, environment: Mapping[str, str] | None = None) -> None:
    """Refuse a world that cannot be built, and values that a service would refuse.

    Args:
        compose: the system.
        world: to be built, where the system has the simulator.
        seed: of the world.
        environment: what the run adds to the environment of the services.

    Raises:
        ConfigError: names the variable or option, what came and what is allowed.
    """
    names = [service.name for service in compose.services]
    if SIMULATOR in names:
        _check_terrain(world, seed)
    from surefoot.lockstep.config import load_config
    from surefoot.lockstep.discover import service_class, service_names

    known = service_names()
    for service in compose.services:
        variables = {**os.environ, **(environment or {}), **service.environment}
        own = f"SUREFOOT_{service.name.upper()}_"
        if service.name in known and any(name.startswith(own) for name in variables):
            load_config(service_class(service.name).Config, service.name, None, variables)


def _check_terrain(world: "World", seed: int) -> None:
    from surefoot.geometry.heightmap import HeightMapError
    from surefoot.services.simulator.ground.terrain import TerrainError
    from surefoot.services.simulator.physics.perturb import find_ground

    try:
        find_ground(world.terrain, seed if world.terrain_seed is None else world.terrain_seed, world.amplitude)
    except (TerrainError, HeightMapError) as error:
        raise ConfigError("invalid", f"{world.terrain}: {error}", "terrain") from None
