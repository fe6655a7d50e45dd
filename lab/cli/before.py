"""Check of the world before anything starts: a reset that fails would come only after all services are up."""

from typing import TYPE_CHECKING

from surefoot.errors import ConfigError

if TYPE_CHECKING:
    from surefoot.schemas.sim import World


def check_ground(world: "World", seed: int) -> None:
    """Refuse a terrain that cannot be built (raises ConfigError)."""
    from surefoot.geometry.heightmap import HeightMapError
    from surefoot.services.simulator.ground.terrain import TerrainError
    from surefoot.services.simulator.physics.perturb import find_ground

    try:
        find_ground(world.terrain, seed if world.terrain_seed is None else world.terrain_seed, world.amplitude)
    except (TerrainError, HeightMapError) as error:
        raise ConfigError("invalid", f"{world.terrain}: {error}", "terrain") from None
