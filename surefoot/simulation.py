"""Simulated robots: a whole scenario with all services, or the physics alone.

simulation.run("flat", seed=1).verdict.value("distance_m")
world = simulation.world("ragno", friction=0.4)
world.step_tick(world.command)
"""

from os import PathLike

from surefoot.arguments import choice, file_path, number, whole
from surefoot.errors import FieldError
from surefoot.files import names
from surefoot.lab.runs.local import LocalRun, run_local
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import KINDS, make_terrain
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.supervisor.scenarios.scenario import load_scenario

__all__ = ["LocalRun", "PhysicsWorld", "run", "scenarios", "world"]

MOST_SEED = 2**31 - 1


def scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios that `run` knows."""
    return names("scenarios", ".toml")


def run(
    scenario: str | PathLike[str], *, seed: int | None = None, recording: str | PathLike[str] | None = None
) -> LocalRun:
    """Run a scenario with all its services in this process, and return its result.

    The same seed gives the same run hash as the command line.

    Args:
        scenario: name or path of its file.
        seed: None = the scenario's own.
        recording: MCAP file to write; None = none.

    Raises:
        SurefootError: there is no such scenario, its system cannot be started, or the recording cannot be written.
    """
    chosen = None if seed is None else whole(seed, "seed", low=0, high=MOST_SEED)
    found, out = (
        load_scenario(str(file_path(scenario, "scenario"))),
        None if recording is None else file_path(recording, "recording"),
    )
    if out is not None:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            out.open("ab").close()
        except OSError as error:
            raise FieldError("unwritable", "recording", f"{out} cannot be written: {error.strerror}") from None
    return run_local(found, chosen, recording=out)


def world(
    robot: str | Robot = "ragno", *, terrain: str = "flat", seed: int = 0, friction: float | None = None
) -> PhysicsWorld:
    """Return a simulation of one robot at rest on a ground, with `samples`, `truth()`, `step_tick(command)` of 10 ms.

    Args:
        robot: name, path or description.
        terrain: kind of ground, see `terrain.generate`.
        seed: of ground and sensors.
        friction: coefficient of the ground; None = the simulator's own.

    Raises:
        SurefootError: an argument that cannot be used, or the robot does not come to rest.
    """
    start = whole(seed, "seed", low=0, high=MOST_SEED)
    physics = Physics() if friction is None else Physics(friction=number(friction, "friction", low=1e-6, high=10.0))
    known = robot if isinstance(robot, Robot) else load_robot(robot)
    return PhysicsWorld(
        known, make_terrain(choice(terrain, "terrain", KINDS), start), start, WorldConfig(physics=physics)
    )
