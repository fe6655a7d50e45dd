"""The world: rest, time, samples, checkpoint, reproducibility, faults that reach the robot."""

import hashlib
import math
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain, terrain_from_map
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.physics.model import Perturbation, Physics
from surefoot.services.simulator.physics.samples import Checkpoint
from surefoot.services.simulator.world import TICK_NS, PhysicsWorld, WorldConfig, WorldError
from tests.processes import run_process
from tests.services.refusals import refused
from tests.services.simulator.stepping import steps

RAGNO = load_robot("ragno")
WEIGHT = RAGNO.mass * 9.81
IDEAL = WorldConfig(imu_profile="ideal")
SLOPE = math.radians(15.0)


@pytest.fixture(scope="module")
def flat_world() -> PhysicsWorld:
    return PhysicsWorld(RAGNO, make_terrain("flat"), config=IDEAL)


@pytest.fixture(scope="module")
def demo_world() -> PhysicsWorld:
    return PhysicsWorld(RAGNO, make_terrain("demo", 1))


@pytest.fixture
def flat(flat_world: PhysicsWorld) -> PhysicsWorld:
    flat_world.reset(seed=0)
    return flat_world


@pytest.fixture
def demo(demo_world: PhysicsWorld) -> PhysicsWorld:
    demo_world.reset(seed=0)
    return demo_world


def march(tick: int) -> np.ndarray:
    """A motion that lifts feet and strains everything. (nj,)"""
    q = RAGNO.neutral.copy()
    for i, leg in enumerate(RAGNO.legs):
        phase = 0.06 * tick + math.pi * (i % 2)
        q[leg.joints[0]] += 0.1 * math.cos(phase)
        q[leg.joints[1]] += 0.35 * max(0.0, math.sin(phase))
    return q


def run(world: PhysicsWorld, ticks: int) -> bytes:
    """Truth and samples of so many ticks of marching, as one digest."""
    digest = hashlib.sha256()
    for _ in range(ticks):
        world.step_tick(march(world.tick))
        for part in filter(lambda part: part is not None, (*world.truth(), *(world.samples.imu or ()))):
            digest.update(np.asarray(part).tobytes())
        digest.update(repr([s is not None for s in world.samples]).encode())
    return digest.digest()


def test_at_rest_sensors_read_gravity_and_weight(flat: PhysicsWorld) -> None:
    steps(flat, 20)
    imu, truth = flat.samples.imu, flat.truth()
    assert imu is not None
    up = 9.81 * matrix_from_quat(truth.quat_wxyz)[2]
    np.testing.assert_allclose(imu.acc, up, atol=1e-3)
    np.testing.assert_allclose(imu.gyro, 0.0, atol=1e-4)
    assert truth.foot_force_n.sum() / WEIGHT == pytest.approx(1.0, abs=1e-3)
    assert truth.foot_force[:, 2].sum() / WEIGHT == pytest.approx(1.0, abs=1e-3)
    assert not truth.fallen
    assert truth.tilt < math.radians(0.1)


def test_rest_on_a_height_field(demo: PhysicsWorld) -> None:
    truth = demo.truth()
    assert truth.foot_force_n.sum() / WEIGHT == pytest.approx(1.0, abs=1e-3)
    assert min(demo.data.contact.dist) > -0.05e-3
    np.testing.assert_allclose(truth.position[:2], 0.0, atol=1e-3)


def test_creep_on_a_slope() -> None:
    config = replace(IDEAL, physics=Physics(friction=0.5))
    world = PhysicsWorld(RAGNO, make_terrain("slope", amp=math.tan(SLOPE)), config=config)
    before = world.truth()
    steps(world, 200)
    after = world.truth()
    assert np.linalg.norm(after.position - before.position) / 2.0 <= 1e-5  # m/s
    assert np.linalg.norm(after.foot_position - before.foot_position, axis=1).mean() / 2.0 <= 1e-5
    assert min(world.data.contact.dist) > -0.05e-3
    assert after.tilt == pytest.approx(SLOPE, abs=0.01)
    assert after.foot_force_n.sum() / WEIGHT == pytest.approx(math.cos(SLOPE), abs=1e-3)


def test_a_sample_is_released_in_the_first_tick_at_or_after_its_stamp(flat: PhysicsWorld) -> None:
    seen = []
    for _ in range(100):
        joints = flat.samples.joints
        assert (joints is None) == (flat.samples.contacts is None)
        assert flat.samples.imu.stamp_ns == flat.stamp_ns == flat.tick * TICK_NS
        assert flat.samples.imu.seq == flat.tick
        if joints is not None:
            seen.append((flat.tick, joints.stamp_ns // 1_000_000, joints.seq))
        flat.step_tick()
    assert [s[1] for s in seen] == [33 * k for k in range(len(seen))]
    assert [s[0] for s in seen] == [-(-33 * k // 10) for k in range(len(seen))]
    assert [s[2] for s in seen] == list(range(len(seen)))


def test_imu_mean_is_the_change_of_velocity(flat: PhysicsWorld) -> None:
    """Nothing is lost between two samples: the mean force over a tick times its length is the change of velocity."""
    flat.push((8.0, 3.0, 0.0), 0.05)
    speed = np.zeros(3)
    before = flat.truth().velocity
    for _ in range(5):
        flat.step_tick()
        assert flat.samples.imu is not None
        rot = flat.data.xmat[flat.address.trunk].reshape(3, 3)
        speed += (rot @ flat.samples.imu.acc - [0.0, 0.0, 9.81]) * TICK_NS * 1e-9
    np.testing.assert_allclose(speed, flat.truth().velocity - before, atol=2e-3)
    assert np.linalg.norm(speed) > 0.01


def test_joints_follow_and_currents_carry(flat: PhysicsWorld) -> None:
    steps(flat, 33)
    joints, contacts = flat.samples.joints, flat.samples.contacts
    assert contacts is not None
    np.testing.assert_allclose(joints.position, RAGNO.neutral, atol=0.03)
    assert np.abs(joints.torque).max() > 0.05
    assert contacts.touch == ((True,),) * 6
    assert contacts.normal_force is None


def test_checkpoint_continues_to_the_bit(demo: PhysicsWorld) -> None:
    demo.add_fault(Fault("packet_loss", 0, 10.0, "imu", 0.2))
    demo.add_fault(Fault("servo_weak", 90, 0.5, "lf", 0.5))
    demo.push((2.0, 1.0, 0.0), 0.3, start_tick=55)
    demo.set("friction", 0.4)
    run(demo, 60)
    saved = demo.checkpoint()
    expected = run(demo, 60)
    last = demo.checkpoint()
    demo.restore(Checkpoint.from_bytes(saved.to_bytes()))
    assert demo.checkpoint().sha256 == saved.sha256
    assert run(demo, 60) == expected
    assert demo.checkpoint().sha256 == last.sha256


def test_checkpoint_continues_in_another_world_object(demo: PhysicsWorld) -> None:
    run(demo, 30)
    saved = demo.checkpoint()
    expected = run(demo, 30)
    other = PhysicsWorld(RAGNO, make_terrain("demo", 1), seed=9)
    other.restore(saved)
    assert run(other, 30) == expected


def test_restart_from_a_checkpoint_counts_from_zero(flat: PhysicsWorld) -> None:
    for tick in range(24):
        flat.step_tick(march(tick))
    saved = flat.checkpoint()
    ahead = []
    for tick in range(20):
        flat.step_tick(march(tick))
        ahead.append(flat.samples)
    flat.restore(saved, restart=True)
    assert (flat.stamp_ns, flat.samples.joints.stamp_ns) == (0, 231_000_000 - 240_000_000)
    for tick, before in enumerate(ahead):
        flat.step_tick(march(tick))
        now = flat.samples
        assert before.imu is not None
        assert (now.imu.stamp_ns, now.imu.seq) == ((tick + 1) * TICK_NS, tick + 1)
        np.testing.assert_array_equal(now.imu.acc, before.imu.acc)
        if now.joints is not None:
            assert now.joints.stamp_ns == before.joints.stamp_ns - 240_000_000
            assert now.joints.seq == before.joints.seq - 7


def test_checkpoint_of_another_world_is_refused(demo: PhysicsWorld, flat: PhysicsWorld) -> None:
    with refused(WorldError, field="checkpoint"):
        flat.restore(demo.checkpoint())


def test_reset_undoes_everything(demo: PhysicsWorld) -> None:
    expected = run(demo, 30)
    demo.set("mass", 1.5)
    demo.set("servo", 0.7)
    demo.push((3.0, 0.0, 0.0), 5.0)
    demo.add_fault(Fault("servo_dead", 0, 5.0, "rm_femur"))
    run(demo, 20)
    demo.reset(seed=0)
    assert run(demo, 30) == expected
    demo.reset(seed=1)
    assert run(demo, 30) != expected


def test_another_process_gives_the_same_bits(demo: PhysicsWorld) -> None:
    code = (
        "from tests.services.simulator.test_world import *\n"
        "print(run(PhysicsWorld(RAGNO, make_terrain('demo', 1), 0), 40).hex())"
    )
    other = run_process([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == run(demo, 40).hex()


def test_physics_and_map_are_the_same_surface(demo: PhysicsWorld) -> None:
    """Rays from above hit the ground where the map has it: rows are y, columns x, row 0 is y-min."""
    _assert_same_surface(demo, 400)


def test_height_field_of_a_file_lies_right() -> None:
    rng = np.random.default_rng(3)
    z = np.zeros((121, 161), dtype=np.float32)  # x from -0.4, y from -0.3
    z[:, 130:] = rng.uniform(0.0, 0.05, (121, 31))
    ground = HeightMap(z=z, cell=0.005, origin=(-0.4, -0.3))
    _assert_same_surface(PhysicsWorld(RAGNO, terrain_from_map(ground)), 300)


def _assert_same_surface(world: PhysicsWorld, n: int) -> None:
    ground = world.terrain.map
    rng = np.random.default_rng(0)
    rows = rng.integers(2, ground.shape[0] - 2, n)
    cols = rng.integers(2, ground.shape[1] - 2, n)
    geom, down = np.zeros((1, 1), dtype=np.int32), np.array([0.0, 0.0, -1.0])
    world.data.qpos[2] += 5.0  # out of the way
    mujoco.mj_forward(world.model, world.data)
    for row, col in zip(rows, cols, strict=True):
        x, y = ground.centre(int(row), int(col))
        start = np.array([x + 1e-5, y + 2e-5, 1.0])  # beside the vertex, where no two triangles meet
        hit = mujoco.mj_ray(world.model, world.data, start, down, None, 1, -1, geom)
        assert hit == pytest.approx(1.0 - ground.z[row, col], abs=4e-4)


def test_push_lasts_as_long_as_it_says(flat: PhysicsWorld) -> None:
    flat.push((0.0, 5.0, 0.0), 0.05, start_tick=10)
    forces = []
    for _ in range(20):
        flat.step_tick()
        forces.append(float(flat.data.xfrc_applied[flat.address.trunk, 1]))
    assert [tick for tick, f in enumerate(forces, 1) if f] == list(range(10, 15))


def test_settings_reach_the_model(flat: PhysicsWorld) -> None:
    flat.set("mass", 2.0)
    steps(flat, 50)
    assert flat.truth().foot_force_n.sum() / WEIGHT == pytest.approx(2.0, rel=0.01)
    flat.set("friction", 0.05)
    assert flat.model.geom_friction[flat.address.terrain_geoms, 0] == pytest.approx(0.05)


def test_dead_servos_let_the_trunk_fall(flat: PhysicsWorld) -> None:
    flat.add_fault(Fault("servo_dead", 5, 100.0))
    steps(flat, 150)
    assert flat.truth().fallen


def test_sensor_faults_reach_the_samples(flat: PhysicsWorld) -> None:
    flat.add_fault(Fault("imu_drop", 3, 0.02))
    flat.add_fault(Fault("foot_stuck_off", 0, 10.0, "rm"))
    flat.add_fault(Fault("packet_delay", 0, 10.0, "joints", 2.0))
    seen = []
    for _ in range(8):
        flat.step_tick()
        seen.append(flat.samples)
    assert [s.imu is None for s in seen] == [False, False, True, True, False, False, False, False]
    assert seen[3].contacts.touch[4] == (False,)
    assert [s.joints is not None for s in seen] == [False, False, False, False, False, True, False, False]
    assert seen[5].joints.stamp_ns == 33_000_000


def test_perturbed_world_never_changes_the_description() -> None:
    config = WorldConfig(perturbation=Perturbation(trunk_mass_scale=1.2, kp_scale=0.8))
    world = PhysicsWorld(RAGNO, make_terrain("flat"), config=config)
    extra = 0.2 * RAGNO.trunk.mass * 9.81
    assert world.truth().foot_force_n.sum() == pytest.approx(WEIGHT + extra, rel=1e-3)
    assert load_robot("ragno").hash == RAGNO.hash


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda w: w.push((1.0, 0.0, 0.0), 0.1, "tail"), "body"),
        (lambda w: w.push((math.nan, 0.0, 0.0), 0.1), "force"),
        (lambda w: w.set("gravity", 1.0), "quantity"),
        (lambda w: w.set("mass", -1.0), "value"),
        (lambda w: w.reset(pose=(50.0, 0.0, 0.0)), "pose"),
        (lambda w: w.reset(stance=np.full(18, 9.0)), "stance"),
        (lambda w: PhysicsWorld(RAGNO, w.terrain, config=WorldConfig(imu_profile="crystal")), "imu_profile"),
    ],
)
def test_refusals_name_the_field(flat: PhysicsWorld, call: object, field: str) -> None:
    with refused(WorldError, field=field):
        call(flat)  # type: ignore[operator]
