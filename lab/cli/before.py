"""Check of the world before anything starts: a reset that fails would come only after all services are up."""

from typing import TYPE_CHECKING

from surefoot.errors import ConfigError

if TYPE_CHECKING:
    from surefoot.schemas.sim import World
    from surefoot.services.supervisor.processes.compose import Compose

SIMULATOR = "simulator"


def check_ground(compose: "Compose", world: "World", seed: int) -> None:
    """Refuse a terrain that cannot be built, where the system has the simulator (raises ConfigError)."""
    from surefoot.geometry.heightmap import HeightMapError
    from surefoot.services.simulator.ground.terrain import TerrainError
    from surefoot.services.simulator.physics.perturb import find_ground

    if SIMULATOR not in compose.service_names:
        return
    try:
        find_ground(world.terrain, seed if world.terrain_seed is None else world.terrain_seed, world.amplitude)
    except (TerrainError, HeightMapError) as error:
        raise ConfigError("invalid", f"{world.terrain}: {error}", "terrain") from None
