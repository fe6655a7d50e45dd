"""The library under one name: light to import, checked at its border, the same numbers as inside."""

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import surefoot
from surefoot.errors import FieldError, SurefootError
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.navigator.belief import ukf
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.stability.programs.contacts import contact_set
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.region import region

FEET = [[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.05]]
NAN = float("nan")
LIGHT = "import sys, surefoot; dir(surefoot); print(surefoot.__version__, 'numpy' in sys.modules, len(sys.modules))"


def test_importing_it_loads_nothing_heavy() -> None:
    done = subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True, check=True)
    version, numpy, modules = done.stdout.split()
    bare = subprocess.run([sys.executable, "-c", "import sys, typing; print(len(sys.modules))"], capture_output=True)
    assert (version, numpy) == (surefoot.__version__, "False")
    assert int(modules) < int(bare.stdout) + 10


def test_every_name_is_there_and_explained() -> None:
    for name in surefoot.__all__:
        part = getattr(surefoot, name)
        assert name == "__version__" or part.__doc__
        for inner in getattr(part, "__all__", ()):
            assert getattr(part, inner).__doc__, f"{name}.{inner}"
    with pytest.raises(AttributeError, match="has no 'stabilty'"):
        _ = surefoot.stabilty


def contacts(points: object = FEET, normals: object = None, friction: object = 0.5) -> object:
    return surefoot.stability.contacts(points, normals, friction)  # type: ignore[arg-type]


def stands() -> surefoot.stability.ContactSet:
    return surefoot.stability.contacts(FEET)


def where() -> surefoot.stability.Region:
    return surefoot.stability.region(stands())


def robot() -> surefoot.robots.Robot:
    return surefoot.robots.load("ragno")


def belief() -> surefoot.navigation.PoseFilter:
    return surefoot.navigation.PoseFilter()


def refusing() -> surefoot.estimation.Estimator:
    return surefoot.estimation.estimator("ragno")


def moved(**parts: object) -> object:
    return refusing().external(0, surefoot.estimation.ExternalSample(**parts))  # type: ignore[arg-type]


GROUND = np.zeros((21, 21))
PATCH = surefoot.terrain.foothold
FLOOR = np.zeros((20, 20))
TURNED = surefoot.stability.ContactSet(np.zeros((3, 4)), np.zeros((3, 4)), np.ones(4))
ROOM = surefoot.navigation.grid(FLOOR)
KILLED = {
    "description": "x", "compose": "ragno",
    "step": [{"when": "ready", "do": "walk", "distance": 0.1}, {"at_tick": 300, "do": "kill", "service": "walker"}],
}  # fmt: skip
BAD: list[tuple[Callable[[], object], str, str, str]] = [
    (lambda: contacts(np.zeros((4, 2))), "shape", "points", "(4, 2)"),
    (lambda: contacts(np.zeros(12)), "shape", "points", "(n, 3)"),
    (lambda: contacts(friction=[0.5] * 4), "shape", "friction", "(3,)"),
    (lambda: contacts(normals=np.zeros((3, 2))), "shape", "normals", "(3, 2)"),
    (lambda: contacts([[0.1, NAN, 0.0]]), "not_finite", "points", "nan at [0, 1]"),
    (lambda: contacts(100.0 * np.array(FEET)), "range", "points", "millimetres"),
    (lambda: contacts(friction=-0.1), "range", "friction", "-0.1"),
    (lambda: contacts(np.array(FEET) + 1j), "type", "points", "numbers"),
    (lambda: surefoot.stability.margin(stands(), [50.0, 0.0]), "range", "com", "millimetres"),
    (lambda: surefoot.stability.margin(where(), [50.0, 0.0]), "range", "com", "millimetres"),
    (lambda: contacts("here"), "type", "points", "'here'"),
    (lambda: contacts([[0.0, 0.0, 0.0], [0.0, 0.0]]), "type", "points", "numbers"),
    (lambda: surefoot.stability.margin(stands(), [NAN, 0.0]), "not_finite", "com", "nan"),
    (lambda: surefoot.stability.margin(FEET, [0.0, 0.0]), "type", "where", "stability.contacts"),  # type: ignore[arg-type]
    (lambda: surefoot.stability.region(stands(), tolerance=0.0), "range", "tolerance", "1e-09"),
    (lambda: surefoot.stability.region(stands(), directions=[[0.0, 0.0]]), "zero_direction", "directions", "zero"),
    (lambda: surefoot.stability.region(stands(), limit=2.5), "type", "limit", "2.5"),  # type: ignore[arg-type]
    (lambda: surefoot.stability.region(stands(), limit=0), "range", "limit", "0"),
    (lambda: surefoot.stability.forces(stands(), [0.0, 0.0], weight=NAN), "not_finite", "weight", "nan"),
    (lambda: surefoot.robots.feet(robot(), np.zeros(17)), "shape", "q", "(18,)"),
    (lambda: surefoot.robots.feet(robot(), np.full(18, 90.0)), "range", "q", "90.0"),
    (lambda: surefoot.robots.joints(robot(), np.full((6, 3), 1.0)), "range", "feet.0", "out of reach"),
    (lambda: surefoot.robots.load("ragnoo"), "not_found", "name", "ragno"),
    (lambda: surefoot.robots.feet("ragno", np.zeros(18)), "type", "robot", "robots.load"),  # type: ignore[arg-type]
    (lambda: surefoot.robots.stance("ragno"), "type", "robot", "robots.load"),  # type: ignore[arg-type]
    (lambda: PATCH(GROUND, 0.005, stroke=(0, 0, 0), allowed=NAN * GROUND), "not_finite", "allowed", "nan"),  # type: ignore[arg-type]
    (lambda: PATCH(GROUND, 0.005, stroke=(0, 0, 0), allowed=GROUND[1:]), "shape", "allowed", "(20, 21)"),  # type: ignore[arg-type]
    (lambda: PATCH(GROUND, 0.005, stroke=(0, 0, 0), model="ragno"), "type", "model", "slip_model"),  # type: ignore[arg-type]
    (lambda: PATCH(GROUND, 0.005, stroke=(0, 0, 0), nominal=(0.5, 0.0)), "range", "nominal", "0.0525"),
    (lambda: PATCH(GROUND, 5.0, stroke=(0, 0, 0)), "range", "cell", "5.0"),
    (lambda: PATCH(GROUND, 0.005, stroke=(0, 0)), "shape", "stroke", "(2,)"),
    (lambda: PATCH(1e3 + GROUND, 0.005, stroke=(0, 0, 0)), "range", "heights", "1000.0"),
    (lambda: PATCH(GROUND[:2], 0.005, stroke=(0, 0, 0)), "shape", "heights", "3 to 301"),
    (lambda: surefoot.terrain.generate(["rough"]), "type", "kind", "name"),  # type: ignore[arg-type]
    (lambda: surefoot.terrain.generate("ruff"), "invalid", "kind", "rough"),
    (lambda: belief().predict(forward=NAN), "not_finite", "forward", "nan"),
    (lambda: belief().predict(turn=90.0), "range", "turn", "90.0"),
    (lambda: belief().predict(sd=(0.1, 0.1)), "shape", "sd", "(2,)"),
    (lambda: belief().landmark((1.0, NAN), 1.0, 0.0), "not_finite", "place", "nan"),
    (lambda: belief().landmark((1.0, 0.0), 1.0, 0.0, sd=(0.0, 0.1)), "range", "sd", "0.0"),
    (lambda: surefoot.navigation.PoseFilter(covariance=-np.eye(3)), "covariance", "covariance", "symmetric"),
    (lambda: surefoot.navigation.grid(FLOOR + 200.0), "range", "source", "200.0"),
    (lambda: surefoot.navigation.grid(FLOOR + 0.9), "range", "source", "percents"),
    (lambda: surefoot.navigation.grid(FLOOR == 0.0), "range", "source", "percents"),
    (lambda: surefoot.navigation.grid(FLOOR - 0.5), "range", "source", "percents"),
    (lambda: surefoot.navigation.plan(ROOM, (0.5, 0.5), (9.0, 0.5)), "outside", "goal", "9.0"),
    (lambda: surefoot.estimation.estimator(), "missing", "robot, feet", "None"),
    (lambda: surefoot.estimation.estimator("ragno", names=["bets"]), "unknown_name", "names", "best"),
    (lambda: surefoot.estimation.estimator("ragno").imu(0, (0, 0, NAN), (0, 0, 9.8)), "nonfinite", "imu", "nan"),
    (lambda: surefoot.estimation.estimator("ragno").imu(0.5, (0, 0, 0), (0, 0, 9.8)), "type", "stamp_ns", "0.5"),  # type: ignore[arg-type]
    (lambda: surefoot.estimation.estimator("ragno").joints(0, (0, 0)), "shape", "joints", "(nj,)"),
    (lambda: surefoot.estimation.estimator("ragno").joints(0, np.zeros(18), (True,)), "shape", "joints", "contact"),
    (lambda: surefoot.estimation.estimator("ragno").external(0, None), "type", "external", "None"),  # type: ignore[arg-type]
    (lambda: surefoot.estimation.run("log.csv", sigma_z=1.0), "unknown_key", "sigma_z", "EstimatorParams"),
    (lambda: surefoot.estimation.estimator(feet=4).joints(0, (0, 0)), "unsupported", "joints", "robot"),
    (lambda: surefoot.estimation.estimator("ragno").reset("x"), "type", "stated", "'x'"),  # type: ignore[arg-type]
    (lambda: PATCH(np.diag(2.0 * np.arange(21)), 0.005, stroke=(0, 0, 0)), "range", "heights", "these millimetres"),
    (lambda: surefoot.simulation.run(KILLED), "invalid", "step", "got kill of walker"),
    (lambda: surefoot.simulation.world(friction=0.0), "range", "friction", "1e-06"),
    (lambda: surefoot.simulation.run("stand", recording="/"), "unwritable", "recording", "cannot be written"),
    (lambda: surefoot.simulation.run("stnd"), "not_found", "", "stand"),
    (lambda: surefoot.simulation.run({"step": []}), "missing", "description", "missing"),
    (lambda: surefoot.simulation.run({"description": "x", "step": [{}]}), "missing", "step[0].do", "missing"),
    (lambda: surefoot.stability.margin(TURNED, [0.0, 0.0]), "shape", "where.position", "(3, 4)"),
    (lambda: contacts(np.ma.masked_less(FEET, 0.0)), "type", "points", "numbers"),
    (lambda: surefoot.navigation.FloorGrid(NAN * FLOOR, 0.05), "bad_grid", "cells", "nan"),  # type: ignore[arg-type]
    (lambda: surefoot.navigation.Clearance(comfort=NAN), "bad_clearance", "comfort", "nan"),
    (lambda: surefoot.navigation.plan(ROOM, (0.2, 0.2), (0.5, 0.5), radius=9.8), "range", "radius", "9.75 m"),
    (lambda: surefoot.terrain.HeightMap(GROUND, 0.01, version=NAN), "invalid", "version", "nan"),  # type: ignore[arg-type]
    (lambda: surefoot.terrain.load(""), "type", "path", "''"),
    (lambda: surefoot.simulation.world(terrain="flatt"), "unknown_name", "terrain", "flat"),
    (lambda: surefoot.estimation.estimator("ragno", names=()), "missing", "names", "()"),
    (lambda: contact_set(np.zeros((3, 4)), np.ones((3, 4)), 0.5), "shape", "contacts.position", "(3, 4)"),
    (lambda: contact_set(FEET, np.ones((3, 3)), [0.5, 0.5]), "shape", "contacts.mu", "each of 3 contacts"),
    (lambda: stands().without(7), "range", "index", "got 7, allowed is 0 to 2"),
    (lambda: stands().without(-1), "range", "index", "got -1, allowed is 0 to 2"),
    (lambda: surefoot.terrain.save(surefoot.terrain.generate("flat"), "/dev/null/x"), "unwritable", "path", "null/x"),
    (lambda: refusing().estimate("nope"), "unknown_name", "name", "got 'nope', running are best"),
    (lambda: refusing().imu(0, (0, 0, 9), (0, 0, 9.8)), "saturated", "imu", "w[2] = 9, allowed are w within +-5.236"),
    (lambda: refusing().imu(0, (0, 0, 0), (0, 0, 99)), "saturated", "imu", "q[2] = 99, allowed are w within"),
    (lambda: refusing().imu(0, (0, 0), (0, 0, 9)), "shape", "imu", "got w (2,) and q (3,), allowed are w (3,) rad/s"),
    (lambda: refusing().joints(0, np.zeros(18), [7] * 6), "range", "joints", "contact[0] = 7, allowed are flags or"),
    (lambda: refusing().joints(0, np.full(18, 90.0)), "range", "joints", "q[0] = 90, allowed are q within +-12.6 rad"),
    (lambda: surefoot.estimation.estimator(feet=4).feet(0, [], []), "shape", "feet", "rot (L, 3, 3) and contact (L,)"),
    (lambda: moved(), "shape", "external", "got a sample without a value"),
    (lambda: moved(yaw=0.0, yaw_variance=-1.0), "covariance", "external", "yaw_variance = -1.0, allowed are numbers a"),
    (lambda: moved(yaw=0.0), "nonfinite", "external", "got yaw_variance = None"),
    (lambda: moved(yaw=1e6, yaw_variance=1.0), "unit", "external", "yaw = 1000000.0, allowed are numbers within"),
    (lambda: moved(velocity=(1, 2), velocity_covariance=np.eye(3)), "shape", "external", "got velocity (2,) and"),
    (lambda: surefoot.bags.check("no.mcap"), "unreadable", "path", "no.mcap"),
    (lambda: surefoot.bags.messages("no.mcap", "state/velocit"), "unknown_topic", "", "state/velocity"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "code", "field", "text"), BAD, ids=lambda p: p if isinstance(p, str) else "")
def test_a_wrong_argument_is_named_with_its_value(call: Callable[[], object], code: str, field: str, text: str) -> None:
    with pytest.raises(SurefootError) as refused:
        call()
    assert (refused.value.code, refused.value.field or "") == (code, field)
    assert text in str(refused.value)


WRONG = (
    NAN,
    -1,
    -math.inf,
    1e300,
    "",
    "x",
    None,
    [],
    {},
    b"x",
    1j,
    object(),
    np.full((4, 3), NAN),
    np.zeros((2, 2, 2)),
)
VALID: dict[str, tuple[Callable[..., object], dict[str, object]]] = {
    "contacts": (surefoot.stability.contacts, {"points": FEET, "normals": None, "friction": 0.5}),
    "forces": (surefoot.stability.forces, {"contacts": stands(), "com": (0.0, 0.0), "weight": 1.0}),
    "lifts": (surefoot.stability.lifts, {"contacts": stands(), "com": (0.0, 0.0)}),
    "margin": (surefoot.stability.margin, {"where": stands(), "com": (0.0, 0.0)}),
    "region": (surefoot.stability.region, {"contacts": stands(), "directions": None, "tolerance": 1e-4, "limit": 128}),
    "HeightMap": (surefoot.terrain.HeightMap, {"z": GROUND, "cell": 0.01, "origin": (0, 0), "version": 0}),
    "foothold": (PATCH, {"heights": GROUND, "cell": 0.005, "stroke": (0, 0, 0), "nominal": (0, 0), "model": None}),
    "generate": (surefoot.terrain.generate, {"kind": "flat", "seed": 0, "amplitude": 0.04}),
    "load": (surefoot.terrain.load, {"path": "no.npz"}),
    "save": (surefoot.terrain.save, {"heightmap": None, "path": "no.npz"}),
    "slip_model": (surefoot.terrain.slip_model, {"source": "ragno"}),
    "FloorGrid": (surefoot.navigation.FloorGrid, {"cells": FLOOR, "cell": 0.05, "origin": (0, 0)}),
    "Clearance": (surefoot.navigation.Clearance, {"radius": 0.1, "comfort": 0.3, "dearest": 4.0, "obstacle": 65}),
    "PoseFilter": (surefoot.navigation.PoseFilter, {"pose": (0, 0, 0), "covariance": np.eye(3)}),
    "grid": (surefoot.navigation.grid, {"source": FLOOR, "cell": 0.05, "origin": (0, 0)}),
    "plan": (surefoot.navigation.plan, {"floor": ROOM, "start": (0.2, 0.2), "goal": (0.5, 0.5), "radius": 0.1}),
    "robots.load": (surefoot.robots.load, {"name": "ragno"}),
    "feet": (surefoot.robots.feet, {"robot": robot(), "q": np.zeros(18)}),
    "joints": (surefoot.robots.joints, {"robot": robot(), "feet": np.zeros((6, 3))}),
    "world": (surefoot.simulation.world, {"robot": "nope", "terrain": "flat", "seed": 0, "friction": 0.5}),
    "simulation.run": (surefoot.simulation.run, {"scenario": "nope", "seed": 0, "recording": None}),
    "estimator": (surefoot.estimation.estimator, {"robot": "ragno", "feet": None, "refused": "raise"}),
    "estimation.run": (surefoot.estimation.run, {"log": "no.csv", "name": "best", "robot": None, "sigma_w": 1e-3}),
    "why": (surefoot.bags.why, {"path": "no.mcap"}),
    "arrays": (surefoot.bags.arrays, {"path": "no.mcap"}),
    "info": (surefoot.bags.info, {"path": "no.mcap"}),
    "check": (surefoot.bags.check, {"path": "no.mcap"}),
}  # fmt: skip


@pytest.mark.parametrize("name", VALID)
def test_no_argument_raises_anything_but_one_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    call, valid = VALID[name]
    for argument in valid:
        for value in WRONG:
            try:
                call(**(valid | {argument: value}))
            except SurefootError as refused:
                assert "\n" not in str(refused)  # noqa: PT017 - most, not all, are refused
    assert not list(tmp_path.iterdir())


def test_a_refused_motion_leaves_the_belief() -> None:
    one = belief()
    with pytest.raises(FieldError):
        one.predict(forward=0.1, turn=NAN)
    assert (one.pose == belief().pose).all()
    assert (one.covariance == belief().covariance).all()


def test_numbers_are_those_of_the_services() -> None:
    inner = contact_set(FEET, [[0, 0, 1]] * 3, 0.5)
    assert surefoot.stability.margin(stands(), (0.02, 0.0)) == margin(region(inner), np.array([0.02, 0.0])).value
    assert surefoot.stability.margin(stands(), (0.02, 0.0, 9.0)) == surefoot.stability.margin(stands(), (0.02, 0.0))
    lifts = surefoot.stability.lifts(stands(), (0.02, 0.0))
    assert lifts == pytest.approx([surefoot.stability.margin(stands().without(i), (0.02, 0.0)) for i in range(3)])
    held = surefoot.stability.forces(stands(), (0.02, 0.0), weight=20.0)
    assert held is not None
    assert held.sum(axis=0) == pytest.approx([0.0, 0.0, 20.0], abs=1e-6)
    assert surefoot.stability.forces(stands(), (0.5, 0.0)) is None
    assert surefoot.stability.margin(surefoot.stability.contacts(np.empty((0, 3))), (0.0, 0.0)) == -math.inf


def test_the_pose_filter_is_the_navigators() -> None:
    one, mean, cov, work = belief(), belief().pose, belief().covariance, ukf.work_space(3)
    one.predict(forward=0.1, left=0.01, turn=0.2, sd=(0.01, 0.02, 0.0))
    ukf.predict(mean, cov, 0.1, 0.01, 0.2, 0.0, np.array([1e-4, 4e-4, 0.0, 0.0]), work)
    nis = one.landmark((1.0, 0.5), 1.1, 0.4, sd=(0.05, 0.02))
    seen = ukf.LandmarkSighting(1.0, 0.5, 1.1, 0.4, 0.0025, 0.0004)
    assert nis == pytest.approx(ukf.update(mean, cov, seen, np.zeros((2, 0)), work))
    assert one.pose == pytest.approx(mean)
    assert one.covariance == pytest.approx(cov)


def test_feet_and_joints_are_inverse() -> None:
    q = surefoot.robots.stance(robot())
    assert surefoot.robots.joints(robot(), surefoot.robots.feet(robot(), q)) == pytest.approx(q, abs=1e-9)


def test_refused_samples_raise_or_are_counted() -> None:
    lenient = surefoot.estimation.estimator(feet=4, refused="count")
    assert lenient.imu(0, (0, 0, NAN), (0, 0, 9.8)) is InputResult.NONFINITE
    strict = surefoot.estimation.estimator(feet=4)
    assert strict.imu(0, (0, 0, 0), (0, 0, 9.8)).accepted
    with pytest.raises(FieldError, match="each stamp once"):
        strict.imu(0, (0, 0, 0), (0, 0, 9.8))
    assert strict.imu(10_000_000, (0, 0, 0), (0, 0, 9.8)).accepted


def test_an_old_stamp_is_refused_as_such() -> None:
    strict = refusing()
    for k in range(20):
        strict.imu(k * 10_000_000, (0, 0, 1e-3 * k), (0, 0, 9.8))
    with pytest.raises(FieldError, match="got stamp_ns = 55000000, allowed are stamps that rise"):
        strict.imu(55_000_000, (0, 0, 0.1), (0, 0, 9.8))


MISUSED: list[tuple[Callable[[surefoot.simulation.StrictWorld], object], str, str]] = [
    (lambda w: w.step_tick([1, 2]), "command", "got shape (2,), expected shape (18,) in rad"),
    (lambda w: w.step_tick(NAN * w.command), "command", "got nan at [0]"),
    (lambda w: w.step_tick(np.full(18, 90.0)), "command", "got 90.0 at [0], allowed is -12.6 to 12.6 rad"),
    (lambda w: w.step_tick(None, [1]), "command", "got None with a torque_limit"),
    (lambda w: w.step_tick(w.command, [1]), "torque_limit", "got shape (1,)"),
    (lambda w: w.step_tick(w.command, np.full(18, -1.0)), "torque_limit", "got -1.0 at [0], allowed is 0"),
    (lambda w: w.push((1, 2), 0.1), "force", "got shape (2,), expected shape (3,) in N"),
    (lambda w: w.push((1e9, 0, 0), 0.1, start_tick=6), "force", "got 1e+09 N, allowed are 0 to "),
    (lambda w: w.push((1, 0, 0), "long"), "duration", "got 'long'"),  # type: ignore[arg-type]
    (lambda w: w.push((1, 0, 0), 0.1, start_tick=-5), "start_tick", "got -5, allowed is 0"),
    (lambda w: w.set("friction", 50.0), "value", "got 50.0, allowed is 0 to 10"),
    (lambda w: w.reset(seed=-1), "seed", "got -1, allowed is 0"),
    (lambda w: w.reset(pose=(1, 2)), "pose", "got shape (2,), expected shape (3,)"),
    (lambda w: w.reset(stance="low"), "stance", "got 'low'"),  # type: ignore[arg-type]
    (lambda w: w.set("friction", "a"), "value", "got 'a', expected numbers"),  # type: ignore[arg-type]
    (lambda w: w.add_fault(3), "fault", "got 3, expected a Fault"),  # type: ignore[arg-type]
    (lambda w: w.add_fault(Fault("imu_bias", 1, "long")), "duration", "got 'long'"),  # type: ignore[arg-type]
    (lambda w: w.restore(3), "saved", "got 3, expected the result of `checkpoint`"),  # type: ignore[arg-type]
    (lambda w: w.displace("on", 0.0, 0.0), "forward", "got 'on'"),  # type: ignore[arg-type]
]  # fmt: skip


@pytest.fixture(scope="module")
def flat() -> surefoot.simulation.StrictWorld:
    return surefoot.simulation.world()


@pytest.mark.parametrize(("call", "field", "text"), MISUSED, ids=lambda p: p if isinstance(p, str) else "")
def test_a_world_refuses_what_it_cannot_use_and_stays(
    flat: surefoot.simulation.StrictWorld, call: Callable[[surefoot.simulation.StrictWorld], object],
    field: str, text: str,
) -> None:  # fmt: skip
    before = flat.checkpoint().sha256
    with pytest.raises(FieldError) as refused:
        call(flat)
    assert refused.value.field == field
    assert str(refused.value).startswith(f"{field}: {text}")
    assert flat.checkpoint().sha256 == before


def steps(world: PhysicsWorld, count: int) -> None:
    for _ in range(count):
        world.step_tick()


def test_a_world_whose_physics_diverge_raises_until_it_is_reset() -> None:
    world = surefoot.simulation.world()
    PhysicsWorld.push(world, (1e9, 0.0, 0.0), 0.1, start_tick=6)  # past the limit of the library
    steps(world, 5)
    with pytest.raises(SurefootError, match=r"diverged by tick \d+: .*accelerations") as raised:
        steps(world, 30)
    assert raised.value.code == "diverged"
    assert 6 <= world.tick < 30
    with pytest.raises(SurefootError, match="diverged"):
        world.step_tick()
    world.reset()
    world.step_tick()


def test_a_world_moves_as_that_of_the_simulator() -> None:
    world = surefoot.simulation.world(seed=3)
    inner = PhysicsWorld(robot(), world.terrain, 3)
    for one in (world, inner):
        one.push((3.0, 0.0, 0.0), 0.1, start_tick=4)
        for _ in range(10):
            one.step_tick(one.command + 0.01)
    assert world.checkpoint().sha256 == inner.checkpoint().sha256


def test_a_foothold_is_scaled_to_the_cells_of_the_patch() -> None:
    fine = surefoot.terrain.foothold(GROUND, 0.005, stroke=(-0.05, 0.0, 0.0))
    coarse = surefoot.terrain.foothold(GROUND, 0.0125, stroke=(-0.05, 0.0, 0.0))
    assert fine.foothold is not None
    assert coarse.foothold is not None
    assert fine.slip == pytest.approx(coarse.slip)


def test_examples_are_listed() -> None:
    folder = Path(__file__).parents[2] / "examples"
    page = (folder / "README.md").read_text()
    for path in folder.rglob("*.py"):
        assert f"({path.relative_to(folder)})" in page, path
