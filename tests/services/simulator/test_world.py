"""The world: rest, time, samples, checkpoint, reproducibility, faults that reach the robot."""

import hashlib
import math
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.rotations import rotate_inverse
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain, terrain_from_map
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.physics.model import Perturbation, Physics
from surefoot.services.simulator.physics.samples import Checkpoint, Detection
from surefoot.services.simulator.world import TICK_NS, PhysicsWorld, WorldConfig, WorldError
from tests.processes import run_process

RAGNO, NAO = load_robot("ragno"), load_robot("nao")
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
        for part in (*world.truth(), *(world.samples.imu or ())):
            digest.update(np.asarray(part).tobytes())
        digest.update(repr([s is not None for s in world.samples]).encode())
    return digest.digest()


# --- rest ---------------------------------------------------------------------------------------------------------


def test_at_rest_sensors_read_gravity_and_weight(flat: PhysicsWorld) -> None:
    for _ in range(20):
        flat.step_tick()
    imu, truth = flat.samples.imu, flat.truth()
    assert imu is not None
    up = rotate_inverse(truth.quat_wxyz, np.array([0.0, 0.0, 9.81]))
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
    for _ in range(200):
        world.step_tick()
    after = world.truth()
    assert np.linalg.norm(after.position - before.position) / 2.0 <= 1e-5  # m/s
    assert np.linalg.norm(after.foot_position - before.foot_position, axis=1).mean() / 2.0 <= 1e-5
    assert min(world.data.contact.dist) > -0.05e-3
    assert after.tilt == pytest.approx(SLOPE, abs=0.01)
    assert after.foot_force_n.sum() / WEIGHT == pytest.approx(math.cos(SLOPE), abs=1e-3)


# --- time and samples ---------------------------------------------------------------------------------------------


def test_a_sample_is_released_in_the_first_tick_at_or_after_its_stamp(flat: PhysicsWorld) -> None:
    seen = []
    for _ in range(100):
        joints = flat.samples.joints
        assert (joints is None) == (flat.samples.contacts is None)
        assert flat.samples.imu is not None
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
    for _ in range(33):
        flat.step_tick()
    joints, contacts = flat.samples.joints, flat.samples.contacts
    assert joints is not None
    assert contacts is not None
    np.testing.assert_allclose(joints.position, RAGNO.neutral, atol=0.03)
    assert np.abs(joints.torque).max() > 0.05
    assert contacts.touch == ((True,),) * 6
    assert contacts.normal_force is None


# --- reproducibility ----------------------------------------------------------------------------------------------


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
    assert flat.stamp_ns == 0
    assert flat.samples.joints is not None
    assert flat.samples.joints.stamp_ns == 231_000_000 - 240_000_000
    for tick, before in enumerate(ahead):
        flat.step_tick(march(tick))
        now = flat.samples
        assert now.imu is not None
        assert before.imu is not None
        assert (now.imu.stamp_ns, now.imu.seq) == ((tick + 1) * TICK_NS, tick + 1)
        np.testing.assert_array_equal(now.imu.acc, before.imu.acc)
        if now.joints is not None:
            assert before.joints is not None
            assert now.joints.stamp_ns == before.joints.stamp_ns - 240_000_000
            assert now.joints.seq == before.joints.seq - 7


def test_checkpoint_of_another_world_is_refused(demo: PhysicsWorld, flat: PhysicsWorld) -> None:
    with pytest.raises(WorldError) as error:
        flat.restore(demo.checkpoint())
    assert error.value.field == "checkpoint"


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


# --- ground -------------------------------------------------------------------------------------------------------


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


# --- disturbances -------------------------------------------------------------------------------------------------


def test_push_lasts_as_long_as_it_says(flat: PhysicsWorld) -> None:
    flat.push((0.0, 5.0, 0.0), 0.05, start_tick=10)
    forces = []
    for _ in range(20):
        flat.step_tick()
        forces.append(float(flat.data.xfrc_applied[flat.address.trunk, 1]))
    assert [tick for tick, f in enumerate(forces, 1) if f] == list(range(10, 15))


def test_settings_reach_the_model(flat: PhysicsWorld) -> None:
    flat.set("mass", 2.0)
    for _ in range(50):
        flat.step_tick()
    assert flat.truth().foot_force_n.sum() / WEIGHT == pytest.approx(2.0, rel=0.01)
    flat.set("friction", 0.05)
    assert flat.model.geom_friction[flat.address.terrain_geoms, 0] == pytest.approx(0.05)


def test_dead_servos_let_the_trunk_fall(flat: PhysicsWorld) -> None:
    flat.add_fault(Fault("servo_dead", 5, 100.0))
    for _ in range(150):
        flat.step_tick()
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
    assert seen[3].contacts is not None
    assert seen[3].contacts.touch[4] == (False,)
    assert [s.joints is not None for s in seen] == [False, False, False, False, False, True, False, False]
    assert seen[5].joints is not None
    assert seen[5].joints.stamp_ns == 33_000_000


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (5.0, -0.5, 1.0), (-0.5, 0.5, -3.0)])
def test_a_run_begins_where_it_is_asked_to(pose: tuple[float, float, float]) -> None:
    truth = PhysicsWorld(NAO, make_terrain("corridor"), config=WorldConfig(start=pose)).truth()
    w, _, _, z = truth.quat_wxyz
    assert truth.position[:2] == pytest.approx(pose[:2], abs=0.01)
    assert 2.0 * math.atan2(z, w) == pytest.approx(pose[2], abs=0.02)


@pytest.mark.parametrize(
    "pose",
    [
        (0.0, 0.95, 0.0),  # a foot in the wall
        (2.9, 1.1, 0.0),  # behind it
        (3.05, 1.05, 0.7),  # across the corner that points inwards
        (2.93, 0.93, 0.785),
        (40.0, 0.0, 0.0),
        (1e9, 0.0, 0.0),
    ],
)
def test_no_run_begins_in_a_wall_or_off_the_ground(pose: tuple[float, float, float]) -> None:
    with pytest.raises(WorldError) as error:
        PhysicsWorld(NAO, make_terrain("corner"), config=WorldConfig(start=pose))
    assert error.value.field == "pose"


def relative(truth: object, pose: tuple[float, float, float]) -> np.ndarray:
    """Feet (L, 3) as seen from a pose on the floor."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rot = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return (truth.foot_position - np.array([*pose[:2], 0.0])) @ rot  # type: ignore[attr-defined]


@pytest.mark.parametrize("robot", [RAGNO, NAO], ids=lambda robot: robot.name)
def test_a_displaced_robot_stands_elsewhere_as_it_stood(robot: Robot) -> None:
    world = PhysicsWorld(robot, make_terrain("corridor"), 1)
    stays = PhysicsWorld(robot, make_terrain("corridor"), 1)
    for _ in range(10):
        world.step_tick()
    world.displace(0.7, -0.2, math.radians(90.0))
    for _ in range(100):
        world.step_tick()
    for _ in range(110):
        stays.step_tick()
    put, stood = world.truth(), stays.truth()
    assert put.position == pytest.approx(stood.position + np.array([0.7, -0.2, 0.0]), abs=1e-3)
    assert relative(put, (*put.position[:2], math.pi / 2)) == pytest.approx(
        relative(stood, (*stood.position[:2], 0.0)), abs=1e-3
    )
    assert not put.fallen
    assert np.all(put.stances == 0)
    assert put.foot_displacement == pytest.approx(0.0, abs=1e-3)
    assert put.contact_sliding == pytest.approx(stood.contact_sliding, abs=1e-3)
    assert put.foot_twist == pytest.approx(stood.foot_twist, abs=1e-3)


def test_a_displaced_robot_does_not_feel_it_but_its_camera_sees_another_floor() -> None:
    world = PhysicsWorld(NAO, make_terrain("corridor"), 1, WorldConfig(imu_profile="ideal"))
    for _ in range(9):
        world.step_tick()
    assert world.sight is not None
    before = {mark.landmark for _ in range(20) for mark in looked(world)}
    world.displace(0.7, 0.0, 3.0)
    rates = []
    for _ in range(30):
        world.step_tick()
        assert world.samples.imu is not None
        rates.append(np.abs(world.samples.imu.gyro).max())
    assert max(rates) < 0.02
    after = {mark.landmark for _ in range(20) for mark in looked(world)}
    assert after
    assert not before & after


def looked(world: PhysicsWorld) -> list[Detection]:
    """Landmarks of the next image."""
    assert world.sight is not None
    world.step_tick()
    while world.sight.frame is None:
        world.step_tick()
    return world.sight.frame.landmarks


@pytest.mark.parametrize(
    ("move", "field"),
    [
        ((0.0, 0.95, 0.0), "forward"),  # into a wall
        ((0.0, 1.5, 0.0), "forward"),  # behind it
        ((50.0, 0.0, 0.0), "forward"),
        ((-100.0, 100.0, 6.0), "forward"),
    ],
)
def test_no_robot_is_put_into_a_wall_or_off_the_ground(move: tuple[float, float, float], field: str) -> None:
    world = PhysicsWorld(NAO, make_terrain("corridor"))
    before = world.truth().position
    with pytest.raises(WorldError) as error:
        world.displace(*move)
    assert error.value.field == field
    assert np.array_equal(world.truth().position, before)


def test_a_robot_is_not_put_on_other_ground_nor_with_a_foot_in_the_air() -> None:
    world = PhysicsWorld(RAGNO, make_terrain("steps"))
    with pytest.raises(WorldError) as error:
        world.displace(0.3, 0.0, 0.0)  # across a riser
    assert error.value.field == "forward"
    world.displace(0.05, 0.05, 0.1)
    q = RAGNO.neutral.copy()
    q[RAGNO.legs[0].joints[1]] -= 0.5
    for _ in range(30):
        world.step_tick(q)
    with pytest.raises(WorldError) as error:
        world.displace(0.0, 0.0, 0.1)
    assert error.value.field == "at_tick"


def test_a_checkpoint_after_a_displacement_has_the_same_future() -> None:
    world = PhysicsWorld(NAO, make_terrain("corridor"), 2)
    world.displace(1.0, 0.3, -1.0)
    world.step_tick()
    saved, futures = world.checkpoint(), []
    for _ in range(2):
        world.restore(saved)
        for _ in range(20):
            world.step_tick()
        futures.append(world.truth().position.tobytes())
    assert futures[0] == futures[1]


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
    with pytest.raises(WorldError) as error:
        call(flat)  # type: ignore[operator]
    assert error.value.field == field
