"""Where a walking robot can be held: its commands end in one tick of a walk, and the joints stay as they are for 3 s.

The walk joins world, estimator and walker by function calls. In every so many ticks the world is saved, held without
commands until it has fallen or 3 s are over, and taken back. Nothing else goes wrong, so a robot that falls here could
not have been held, and one that stands could. The driver holds the same way when no command comes (100 ms).

    python -m benchmarks.bench_held --seeds 0:4 --every 5
    python -m benchmarks.bench_held nao --seeds 0:20
"""

import argparse
from collections import Counter
from collections.abc import Sequence

from benchmarks.bench_study import seeds_of, wilson
from surefoot.lab.runs.joined import sense
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.hexapod.gait import HexapodWalker
from surefoot.services.walker.interface import MotionCommand, WalkerOutputs

ROBOTS = ("bioloid", "nao", "ragno")
HELD_TICKS = 300
LEVEL = 1.0  # of perturbation: masses, servos and sensors differ from the description as those of a real robot
DISTANCE_M = 0.2
MOST_TICKS = 3000


def walk(name: str, seed: int, every: int) -> list[tuple[str, bool]]:
    """Return for the moments of one walk whether one foot or all stood, and whether the held robot fell."""
    robot = load_robot(name)
    config = WorldConfig(perturbation=perturbation(LEVEL, seed, robot.nj, robot.kind))
    world = PhysicsWorld(robot, make_terrain("flat"), seed, config)
    estimator = Estimator.for_robot(robot)
    walker = BipedWalker(robot) if robot.kind == "biped" else HexapodWalker(robot)
    pending, found, walked = world.command.copy(), list[tuple[str, bool]](), False
    for tick in range(MOST_TICKS):
        inputs, _ = sense(world, estimator)
        out: WalkerOutputs = walker.step(inputs)
        command, pending = pending, world.command if out.command is None else out.command
        world.step_tick(command)
        if out.state == "standing":
            if walked:
                return found
            walked = walker.command(MotionCommand("walk", distance=DISTANCE_M)).accepted
        elif walked and tick % every == 0:
            found.append(("all feet" if bool(out.stance.all()) else "in a step", falls(world)))
    raise RuntimeError(f"{name} seed {seed} does not end its walk in {MOST_TICKS} ticks")


def falls(world: PhysicsWorld) -> bool:
    """Return whether a world without commands falls within 3 s; it is as before afterwards."""
    saved = world.checkpoint()
    for _ in range(HELD_TICKS):
        world.step_tick(None)
        if world.truth().fallen:
            break
    fallen = bool(world.truth().fallen)
    world.restore(saved)
    return fallen


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line; without arguments all robots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", nargs="*", default=ROBOTS)
    parser.add_argument("--seeds", default="0:4", help="count, or first:end")
    parser.add_argument("--every", type=int, default=5, help="ticks between two moments")
    args = parser.parse_args(arguments)
    for name in args.robot:
        total, fallen = Counter[str](), Counter[str]()
        for seed in seeds_of(args.seeds):
            for where, fell in walk(name, seed, args.every):
                total[where] += 1
                fallen[where] += fell
        for where in sorted(total):
            high = wilson(fallen[where], total[where])[1]
            print(
                f"{name:<8} held {where:<9} {fallen[where]:4} of {total[where]:4} fall (below {100 * high:.1f} %, 95 %)"
            )


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
