import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from surefoot.geometry import rotations as rot

Component = st.floats(-1.0, 1.0)
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
Angle = st.floats(-math.pi, math.pi)


@st.composite
def quats(draw):
    q = draw(arrays(np.float64, 4, elements=Component).filter(lambda v: np.linalg.norm(v) > 0.1))
    return q / np.linalg.norm(q)


vectors = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0))


def rotated(q, v):
    """v' = q v q* of a unit quaternion."""
    return rot.multiply(rot.multiply(q, np.array([0.0, *v])), q * CONJUGATE)[1:]


def same_rotation(a, b, tol=1e-12):
    return min(np.abs(a - b).max(), np.abs(a + b).max()) < tol


@given(quats(), quats(), quats())
def test_multiply_is_a_group(a, b, c):
    assert np.allclose(rot.multiply(rot.multiply(a, b), c), rot.multiply(a, rot.multiply(b, c)), atol=1e-14)
    assert np.allclose(rot.multiply(a, a * CONJUGATE), [1, 0, 0, 0], atol=1e-14)


@given(quats(), quats(), vectors)
def test_product_rotates_by_the_right_factor_first(a, b, v):
    assert np.allclose(rotated(rot.multiply(a, b), v), rotated(a, rotated(b, v)), atol=1e-12)


@given(quats(), vectors)
def test_matrix_and_quaternion_rotate_alike(q, v):
    m = rot.matrix_from_quat(q)
    assert np.allclose(m @ v, rotated(q, v), atol=1e-12)
    assert np.allclose(m.T @ v, rotated(q * CONJUGATE, v), atol=1e-12)
    assert np.allclose(m @ m.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(m) == pytest.approx(1.0)


@given(quats())
def test_matrix_round_trip(q):
    back = rot.quat_from_matrix(rot.matrix_from_quat(q))
    assert same_rotation(back, q)
    assert back[0] >= 0.0


@pytest.mark.parametrize("axis", range(3))
def test_half_turns_round_trip(axis):
    m = -np.eye(3)
    m[axis, axis] = 1.0
    assert np.allclose(rot.matrix_from_quat(rot.quat_from_matrix(m)), m)


@given(vectors)
def test_exp_of_log_is_the_same_rotation(v):
    q = rot.quat_from_rotvec(v)
    w = rot.rotvec_from_quat(q)
    assert np.linalg.norm(w) <= math.pi + 1e-12
    assert same_rotation(rot.quat_from_rotvec(w), q)
    assert np.allclose(rot.matrix_from_rotvec(v), rot.matrix_from_quat(q))
    assert same_rotation(rot.quat_from_rotvec(rot.rotvec_from_matrix(rot.matrix_from_quat(q))), q, 1e-7)


@pytest.mark.parametrize("scale", [0.0, 1e-300, 1e-12, 0.9e-8, 1.1e-8, 1e-3])
def test_small_rotation_vectors_survive(scale):
    v = scale * np.array([0.6, -0.48, 0.64])
    assert np.allclose(rot.rotvec_from_quat(rot.quat_from_rotvec(v)), v, rtol=1e-12, atol=0.0)


@given(vectors, Angle)
def test_axis_angle_equals_the_rotation_vector(v, angle):
    norm = np.linalg.norm(v)
    axis = v / norm if norm > 1e-3 else np.array([0.0, 0.0, 1.0])
    assert np.allclose(rot.matrix_from_axis_angle(axis, angle), rot.matrix_from_rotvec(angle * axis), atol=1e-12)


@given(Angle, st.floats(-1.5, 1.5), Angle)
def test_rpy_round_trip(roll, pitch, yaw):
    m = rot.matrix_from_rpy(roll, pitch, yaw)
    rx = rot.matrix_from_axis_angle(np.array([1.0, 0.0, 0.0]), roll)
    ry = rot.matrix_from_axis_angle(np.array([0.0, 1.0, 0.0]), pitch)
    rz = rot.matrix_from_axis_angle(np.array([0.0, 0.0, 1.0]), yaw)
    assert np.allclose(m, rz @ ry @ rx, atol=1e-12)
    assert np.allclose(rot.matrix_from_rpy(*rot.rpy_from_matrix(m)), m, atol=1e-9)
    assert np.allclose(rot.matrix_from_quat(rot.quat_from_rpy(roll, pitch, yaw)), m, atol=1e-12)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_rpy_at_the_pole_is_the_same_rotation(pitch):
    m = rot.matrix_from_rpy(0.3, pitch, 0.8)
    rpy = rot.rpy_from_matrix(m)
    assert rpy[0] == 0.0
    assert np.allclose(rot.matrix_from_rpy(*rpy), m, atol=1e-7)


def test_signs_follow_rep_103():
    nose_down, left_up = rot.quat_from_rpy(0.0, 0.1, 0.0), rot.quat_from_rpy(0.1, 0.0, 0.0)
    assert rotated(nose_down, np.array([1.0, 0.0, 0.0]))[2] < 0.0
    assert rotated(left_up, np.array([0.0, 1.0, 0.0]))[2] > 0.0


@given(st.floats(-100.0, 100.0))
def test_wrapped_angle_is_the_same_direction(angle):
    wrapped = rot.wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


def test_wrap_keeps_plus_pi():
    assert rot.wrap_angle(math.pi) == math.pi
    assert rot.wrap_angle(-math.pi) == math.pi
