"""Simulated robots: a whole scenario with all services, or the physics alone.

simulation.run("flat", seed=1).verdict.value("distance_m")
world = simulation.world("ragno", friction=0.4)
world.step_tick(world.command)
"""

from collections.abc import Mapping
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from surefoot.arguments import WIDEST_ANGLE, array, choice, file_path, flag, instance, number, whole
from surefoot.errors import FieldError, SurefootError
from surefoot.files import names
from surefoot.lab.runs.local import LocalRun, run_local
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import KINDS, make_terrain
from surefoot.services.simulator.physics.disturb import too_strong
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.physics.samples import Checkpoint
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.supervisor.scenarios.scenario import load_scenario, scenario_of

__all__ = ["LocalRun", "PhysicsWorld", "StrictWorld", "run", "scenarios", "world"]

MOST_SEED = 2**31 - 1
MOST_FRICTION, MOST_FACTOR = 10.0, 100.0
"""`MOST_FRICTION`: largest coefficient of friction of a world; `MOST_FACTOR`: largest factor on masses and gains."""


class StrictWorld(PhysicsWorld):
    """A `PhysicsWorld` that raises a SurefootError for each argument it cannot use, and once its physics diverge."""

    def reset(
        self, seed: int | None = None, pose: ArrayLike | None = None, stance: ArrayLike | None = None
    ) -> None:  # fmt: skip
        """Reset the world to tick 0, the robot at rest in a stance; equal arguments give equal bits.

        Args:
            seed: seed of sensors and faults, >= 0; None = the last one.
            pose: x, y in m and yaw in rad of the trunk before it settles, (3,); None = where it was at first.
            stance: joint angles that are held, (nj,), rad; None = neutral.

        Raises:
            SurefootError: an argument that cannot be used, or the robot does not come to rest.
        """
        x, y, yaw = self.config.start if pose is None else array(pose, "pose", (3,)).tolist()
        angles = None if stance is None else array(stance, "stance", (self.robot.nj,), "rad")
        super().reset(None if seed is None else whole(seed, "seed", low=0), (x, y, yaw), angles)

    def step_tick(self, command: ArrayLike | None = None, torque_limit: ArrayLike | None = None) -> None:
        """Advance one control tick of 10 ms.

        Args:
            command: joint positions for the servos, (nj,), rad, within +-12.6; None = hold.
            torque_limit: the most the servos may give for the command, (nj,), Nm, >= 0; None = what they can.

        Raises:
            SurefootError: an argument that cannot be used; or, of code `diverged`, the physics have left all bounds and
                the robot was put back: `reset` or `restore` the world.
        """
        if command is None and torque_limit is not None:
            raise FieldError("missing", "command", "got None with a torque_limit, expected joint angles in rad")
        nj = (self.robot.nj,)
        q = None if command is None else array(command, "command", nj, "rad", low=-WIDEST_ANGLE, high=WIDEST_ANGLE)
        super().step_tick(q, None if torque_limit is None else array(torque_limit, "torque_limit", nj, "Nm", low=0.0))
        if found := self.diverged:
            text = f"the physics diverged by tick {self.tick}: {found} not finite or huge; reset or restore the world"
            raise SurefootError("diverged", text)

    def push(self, force: ArrayLike, duration: float, body: str = "trunk", start_tick: int = 0) -> None:
        """Plan a push: a force at the centre of mass of a link.

        Args:
            force: force vector, (3,) N, world axes, at most 100 times the weight of the robot.
            duration: duration of the push, s, rounded to whole ticks.
            body: name of a link; "trunk" is base_link.
            start_tick: first tick; the next one if that has passed.

        Raises:
            SurefootError: an argument that cannot be used.
        """
        x, y, z = array(force, "force", (3,), "N").tolist()
        if wrong := too_strong(self.robot, (x, y, z)):
            raise FieldError("range", "force", wrong)
        instance(body, "body", str, "the name of a link")
        super().push((x, y, z), number(duration, "duration", "s"), body, whole(start_tick, "start_tick", low=0))

    def displace(self, forward: float, left: float, turn: float, *, only_ask: bool = False) -> None:
        """Move the robot by `forward`, `left` (m) and `turn` (rad), heading axes; `only_ask`: only check the place.

        Raises:
            SurefootError: an invalid number, a foot is in the air, or the robot cannot stand there.
        """
        way = number(forward, "forward", "m"), number(left, "left", "m"), number(turn, "turn", "rad")
        super().displace(*way, only_ask=flag(only_ask, "only_ask"))

    def set(self, quantity: str, value: float) -> None:
        """Change the world while it runs.

        Args:
            quantity: `friction` (coefficient of the ground), `mass` or `servo` (factors on all masses, all gains).
            value: above 0; a friction of at most 10, as of `world`, a factor of at most 100.

        Raises:
            SurefootError: unknown quantity or impossible value.
        """
        instance(quantity, "quantity", str, "the name of a quantity")
        most = MOST_FRICTION if quantity == "friction" else MOST_FACTOR
        super().set(quantity, number(value, "value", low=0.0, high=most))

    def add_fault(self, fault: Fault) -> None:
        """Plan a fault, which begins at its `start_tick` and lasts for its `duration`.

        Raises:
            SurefootError: unknown kind or target, a kind that the robot has no sensor for, or a value out of range.
        """
        instance(fault, "fault", Fault, "a Fault")
        for field in ("start_tick", "duration", "value"):
            number(getattr(fault, field), field)
        for field in ("kind", "target"):
            instance(getattr(fault, field), field, str, "a name")
        whole(fault.seed, "seed", low=-self.seed)
        super().add_fault(fault)

    def restore(self, saved: Checkpoint, *, restart: bool = False) -> None:
        """Restore a checkpoint of this world, from which it continues equally to the bit.

        Args:
            saved: result of `checkpoint` of this world.
            restart: count stamps and sequence numbers from here; `tick` goes on, so that pushes and faults keep their
                time.

        Raises:
            SurefootError: no checkpoint, or one of another robot, ground or configuration.
        """
        instance(saved, "saved", Checkpoint, "the result of `checkpoint`")
        super().restore(saved, restart=flag(restart, "restart"))


def scenarios() -> tuple[str, ...]:
    """Return the names of the scenarios that `run` knows."""
    return names("scenarios", ".toml")


def run(
    scenario: str | PathLike[str] | Mapping[str, Any], *, seed: int | None = None,
    recording: str | PathLike[str] | None = None,
) -> LocalRun:  # fmt: skip
    """Run a scenario with all its services in this process, and return its result.

    The same seed gives the same run hash as the command line.

    Args:
        scenario: name, path of its file, or the keys of such a file, as `{"description": ..., "step": [...]}`.
        seed: None = the scenario's own.
        recording: MCAP file to write; None = none.

    Raises:
        SurefootError: there is no such scenario, one of its keys cannot be used, its system cannot be started, or the
            recording cannot be written.
    """
    chosen = None if seed is None else whole(seed, "seed", low=0, high=MOST_SEED)
    given = scenario_of(scenario) if isinstance(scenario, Mapping) else None
    found = given or load_scenario(str(file_path(scenario, "scenario")))
    out = None if recording is None else file_path(recording, "recording")
    if out is not None:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
            out.open("ab").close()
        except OSError as error:
            raise FieldError("unwritable", "recording", f"{out} cannot be written: {error.strerror}") from None
    return run_local(found, chosen, recording=out)


def world(
    robot: str | Robot = "ragno", *, terrain: str = "flat", seed: int = 0, friction: float | None = None
) -> StrictWorld:
    """Return a simulation of one robot at rest on a ground, with `samples`, `truth()`, `step_tick(command)` of 10 ms.

    Args:
        robot: name, path or description.
        terrain: kind of ground, see `terrain.generate`.
        seed: seed of ground and sensors.
        friction: coefficient of the ground; None = the simulator's own.

    Raises:
        SurefootError: an argument that cannot be used, or the robot does not come to rest.
    """
    start = whole(seed, "seed", low=0, high=MOST_SEED)
    ground = None if friction is None else number(friction, "friction", low=1e-6, high=MOST_FRICTION)
    physics = Physics() if ground is None else Physics(friction=ground)
    known = robot if isinstance(robot, Robot) else load_robot(robot)
    return StrictWorld(
        known, make_terrain(choice(terrain, "terrain", KINDS), start), start, WorldConfig(physics=physics)
    )
