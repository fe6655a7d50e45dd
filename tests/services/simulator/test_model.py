import math

import mujoco
import numpy as np
import pytest

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot import kinematics as kin
from surefoot.robot.reader import load_robot, robot_names
from surefoot.services.simulator.ground.terrain import Terrain, TerrainBox, make_terrain
from surefoot.services.simulator.physics.model import Perturbation, Physics, build_model, build_spec, retune

RAGNO = load_robot("ragno")


def standing(robot, terrain=None, physics=None, perturb=None, height=None, normal=(0.0, 0.0, 1.0)):
    """Model and data with the feet in the neutral stance on the plane through the origin."""
    model, addresses = build_model(robot, terrain, perturb, physics)
    data = mujoco.MjData(model)
    if height is None:
        height = robot.foot_radius - kin.foot_positions(robot.model, robot.neutral)[:, 2].min()
    tilt = math.atan2(normal[0], normal[2])
    data.qpos[:7] = [height * normal[0], 0.0, height * normal[2], math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0]
    data.qpos[addresses.joint_qpos] = robot.neutral
    data.ctrl[addresses.actuators] = robot.neutral
    return model, data, addresses


def run(model, data, seconds):
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)


def feet_force(model, data, addresses):
    """World vertical force on each foot, (L,) N."""
    force, wrench = np.zeros(len(addresses.foot_bodies)), np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        foot = addresses.foot_of_geom[contact.geom].max()
        mujoco.mj_contactForce(model, data, i, wrench)
        up = contact.frame.reshape(3, 3).T @ wrench[:3]
        force[foot] += up[2] * (1.0 if addresses.foot_of_geom[contact.geom[1]] >= 0 else -1.0)
    return force


@pytest.mark.parametrize("name", robot_names())
def test_compiled_model_equals_the_description(name):
    robot = load_robot(name)
    model, at = build_model(robot)
    play = sum(robot.joints[link.joint].servo.backlash > 0 for link in robot.links if link.joint >= 0)
    assert model.nq == robot.nj + 7 + len(at.coupled) + play
    assert model.nu == robot.nj
    assert np.array_equal(at.joint_qpos, np.arange(model.nq)[at.joint_qpos_slice])
    assert np.array_equal(at.joint_dof, np.arange(model.nv)[at.joint_dof_slice])
    assert np.allclose(model.body_mass[at.bodies], [link.mass for link in robot.links])
    assert np.allclose(model.body_ipos[at.bodies], [link.com for link in robot.links])
    assert np.allclose(model.body_inertia[at.bodies], [link.inertia for link in robot.links])
    assert np.allclose(model.body_iquat[at.bodies], [link.inertia_quat_wxyz for link in robot.links])
    for j, joint in enumerate(robot.joints):
        assert model.jnt_range[model.joint(joint.name).id] == pytest.approx([joint.lower, joint.upper])  # rad
        assert model.actuator_gainprm[at.actuators[j], 0] == joint.servo.kp
        assert model.actuator_forcerange[at.actuators[j]].tolist() == [-joint.servo.max_torque, joint.servo.max_torque]
        assert model.dof_armature[at.joint_dof[j]] == joint.servo.armature
    assert [model.geom(g).bodyid[0] for g in at.foot_geoms[:, 0]] == at.foot_bodies.tolist()
    assert model.geom_size[at.foot_geoms[:, 0], 0] == pytest.approx(robot.foot_radius)
    assert len(at.belly_geoms) == len(robot.trunk.belly)
    assert model.site_pos[at.imu_site] == pytest.approx(robot.imu.position)
    assert np.flatnonzero(at.is_terrain).tolist() == at.terrain_geoms.tolist() == [0]


def test_contact_settings_of_the_design_note():
    model, at = build_model(RAGNO)
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert (model.opt.impratio, model.opt.timestep) == (100.0, 1e-3)
    assert model.geom_solref[at.terrain_geoms[0]].tolist() == [0.005, 1.0]
    assert model.geom_priority[at.terrain_geoms[0]] > model.geom_priority[at.foot_geoms].max()


@pytest.mark.parametrize("segments", [False, True])
def test_only_what_may_touch_the_terrain_can(segments):
    model, at = build_model(RAGNO, physics=Physics(segment_contacts=segments))
    touches = (model.geom_conaffinity & model.geom_contype[0]).astype(bool)
    assert np.array_equal(touches, (at.foot_of_geom >= 0) | at.is_belly)
    assert touches.sum() == 6 + 4 + (18 if segments else 0)
    robot_geoms = ~at.is_terrain
    assert not np.any(model.geom_contype[robot_geoms])  # so no self-collision


@pytest.mark.parametrize("name", ["ragno", "messor"])
def test_robot_stands_and_the_feet_carry_its_weight(name):
    robot = load_robot(name)
    model, data, at = standing(robot)
    run(model, data, 2.0)
    assert np.abs(data.qvel).max() < 1e-4
    assert feet_force(model, data, at).sum() == pytest.approx(robot.mass * 9.81, rel=1e-4)
    assert abs(data.qpos[at.joint_qpos] - robot.neutral).max() < math.radians(5)
    penetration = -min(data.contact[i].dist for i in range(data.ncon))
    assert penetration < 5e-5


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_no_creep_on_a_slope(direction):
    tilt = direction * math.radians(15)
    normal = (-math.sin(tilt), 0.0, math.cos(tilt))
    ground = Terrain("slope", 0, math.tan(tilt), make_terrain("flat").map, normal=normal)
    model, data, at = standing(RAGNO, ground, Physics(friction=0.5), normal=normal)
    run(model, data, 1.5)
    trunk, feet = data.qpos[:3].copy(), data.geom_xpos[at.foot_geoms[:, 0]].copy()
    run(model, data, 1.0)
    assert np.linalg.norm(data.qpos[:3] - trunk) < 1e-5  # the note's target is 0.01 mm/s
    assert np.linalg.norm(data.geom_xpos[at.foot_geoms[:, 0]] - feet, axis=1).max() < 1.2e-5  # with rolling
    assert np.abs(data.geom_xpos[at.foot_geoms[:, 0]] @ normal - RAGNO.foot_radius).max() < 5e-5


def test_slope_steeper_than_friction_slides():
    terrain = make_terrain("slope", amp=math.tan(math.radians(35)))
    model, data, _ = standing(RAGNO, terrain, Physics(friction=0.3), normal=terrain.normal)
    run(model, data, 0.5)
    assert np.linalg.norm(data.qvel[:3]) > 0.5


def saddle():
    """Rows differ from columns, so a flip or a transposition shows."""
    x, y = np.arange(-40, 81) * 0.01, np.arange(-60, 41) * 0.01
    z = 0.1 + 0.2 * x[None, :] - 0.1 * y[:, None] + 0.3 * x[None, :] * y[:, None]
    return HeightMap(z.astype(np.float32), 0.01, (x[0], y[0]))


def test_height_field_is_the_map():
    ground = saddle()
    model, _ = build_model(RAGNO, Terrain("test", 0, 1.0, ground, ground=ground))
    data = mujoco.MjData(model)
    data.qpos[:3] = [0.0, 0.0, 50.0]  # out of the way
    mujoco.mj_forward(model, data)
    rng, geom = np.random.default_rng(3), np.zeros(1, dtype=np.int32)
    for _ in range(200):
        row, col = rng.integers(1, ground.shape[0] - 1), rng.integers(1, ground.shape[1] - 1)
        x, y = ground.centre(int(row), int(col))
        hit = mujoco.mj_ray(model, data, [x, y, 5.0], [0, 0, -1.0], None, 1, -1, geom, None)
        assert 5.0 - hit == pytest.approx(float(ground.z[row, col]), abs=1e-6)


def test_feet_rest_on_the_dilated_map():
    ground = saddle()
    model, data, at = standing(RAGNO, Terrain("test", 0, 1.0, ground, ground=ground), height=0.25)
    run(model, data, 2.0)
    dilated = ground.dilated(RAGNO.foot_radius)
    heights = [z - dilated.height_at(x, y) for x, y, z in data.geom_xpos[at.foot_geoms[:, 0]]]
    loaded = feet_force(model, data, at) > 0.1  # on a saddle not every foot of a stiff robot carries
    assert loaded.sum() >= 3
    assert np.abs(np.array(heights)[loaded]).max() < 5e-4
    assert min(heights) > -5e-4


def test_flat_height_field_equals_the_plane():
    flat = make_terrain("flat").map
    plane, field = standing(RAGNO), standing(RAGNO, Terrain("test", 0, 0.0, flat, ground=flat))
    for model, data, _ in (plane, field):
        run(model, data, 1.0)
    assert plane[1].qpos[2] == pytest.approx(field[1].qpos[2], abs=1e-4)


def test_unknown_cells_are_refused():
    z = np.zeros((5, 5), dtype=np.float32)
    z[2, 2] = np.nan
    ground = HeightMap(z, 0.01)
    with pytest.raises(ValueError, match="known heights"):
        build_spec(RAGNO, Terrain("test", 0, 0.0, ground, ground=ground))
    with pytest.raises(ValueError, match="normal"):
        build_spec(RAGNO, Terrain("test", 0, 0.0, ground, normal=(0.0, 0.0, -1.0)))


def test_box_top_carries_the_robot():
    box = TerrainBox((0.0, 0.0, 0.02), (0.4, 0.4, 0.03))
    height = 0.05 + RAGNO.foot_radius + 0.0691
    terrain = Terrain("test", 0, 0.0, make_terrain("flat").map, boxes=(box,))
    model, data, at = standing(RAGNO, terrain, height=height)
    run(model, data, 1.0)
    assert data.geom_xpos[at.foot_geoms[:, 0], 2] == pytest.approx(0.05 + RAGNO.foot_radius, abs=5e-5)
    assert at.terrain_geoms.tolist() == [0, 1]


@pytest.mark.parametrize("terrain", ["demo", "rough"])
def test_dropped_robot_comes_to_rest_on_top_of_the_height_field(terrain):
    model, data, at = standing(RAGNO, make_terrain(terrain, seed=2), height=0.35)
    data.qpos[0] = 0.6
    run(model, data, 3.0)
    assert np.abs(data.qvel).max() < 1e-2
    under = [data.contact[i].dist for i in range(data.ncon)]
    assert min(under) > -1e-4
    ground = make_terrain(terrain, seed=2).map
    for x, y, z in data.geom_xpos[at.foot_geoms[:, 0]]:
        assert z > ground.height_at(x, y)


PERTURBED = Perturbation(
    trunk_mass_scale=1.1,
    trunk_com_offset=(0.004, -0.003, 0.005),
    leg_mass_scale=0.95,
    friction_scale=0.6,
    kp_scale=np.linspace(0.85, 1.15, 18),
    kv_scale=1.2,
    torque_scale=np.r_[0.0, np.ones(17)],
)


def test_perturbation_changes_the_model_and_never_the_robot():
    before = [link.mass for link in RAGNO.links], RAGNO.trunk.com.copy(), RAGNO.model.com.copy()
    model, at = build_model(RAGNO, perturb=PERTURBED)
    assert model.body_mass[at.trunk] == pytest.approx(1.1 * RAGNO.trunk.mass)
    assert model.body_ipos[at.trunk] == pytest.approx([0.004, -0.003, 0.005])
    assert model.geom_friction[0, 0] == pytest.approx(0.42)
    assert model.actuator_gainprm[at.actuators, 0] == pytest.approx(12 * PERTURBED.kp_scale)
    assert model.actuator_biasprm[at.actuators, 1] == pytest.approx(-12 * PERTURBED.kp_scale)
    assert model.actuator_biasprm[at.actuators, 2] == pytest.approx(-0.25 * 1.2)
    assert model.actuator_forcerange[at.actuators[0]] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert before[0] == [link.mass for link in RAGNO.links]
    assert np.array_equal(before[1], RAGNO.trunk.com)
    assert np.array_equal(before[2], RAGNO.model.com)
    assert load_robot("ragno").hash == RAGNO.hash


def test_retuned_model_equals_one_built_so():
    built, at = build_model(RAGNO, perturb=PERTURBED)
    tuned, _ = build_model(RAGNO)
    for _ in range(2):  # relative to the description: twice is the same
        retune(tuned, at, RAGNO, PERTURBED)
    states = []
    for model in (built, tuned):
        data = mujoco.MjData(model)
        data.qpos[:3] = [0.0, 0.0, 0.08]
        data.qpos[at.joint_qpos] = RAGNO.neutral
        data.ctrl[:] = RAGNO.neutral
        run(model, data, 0.3)
        states.append(data.qpos.copy())
    assert np.allclose(states[0], states[1], atol=1e-9)
    retune(tuned, at, RAGNO, Perturbation())
    nominal, _ = build_model(RAGNO)
    assert np.allclose(tuned.body_mass, nominal.body_mass)
    assert np.allclose(tuned.actuator_biasprm, nominal.actuator_biasprm)
    assert np.allclose(tuned.body_invweight0, nominal.body_invweight0)


def test_dead_servo_lets_its_joint_hang():
    perturb = Perturbation(torque_scale=np.r_[1.0, 0.0, np.ones(16)])
    model, data, at = standing(RAGNO, perturb=perturb, height=0.5)
    model.opt.gravity[:] = 0.0
    data.ctrl[at.actuators] += 0.2
    run(model, data, 0.5)
    moved = np.abs(data.qpos[at.joint_qpos] - RAGNO.neutral)
    assert moved[1] < 0.05
    assert moved[[0, 4, 7]].min() > 0.1


def test_same_input_same_bits():
    states = []
    for _ in range(2):
        model, data, _ = standing(RAGNO, make_terrain("demo", seed=1), height=0.2)
        run(model, data, 0.3)
        states.append(data.qpos.tobytes())
    assert states[0] == states[1]
