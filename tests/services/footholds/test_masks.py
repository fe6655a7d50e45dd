"""Each reason against a cell, set by a ground or pose made for it."""

import math

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rpy, quat_from_matrix
from surefoot.robot.kinematics import leg_ik
from surefoot.services.footholds.masks import REASONS, Limits, Reason, count_reasons, gradient, mask_window
from surefoot.services.footholds.select import TrunkPose, placement
from tests.services.footholds.grounds import CELL, STROKE, flat, ground_of, neutral, ragno, standing

FREE = np.full((15, 15), 0.04, dtype=np.float32)


def about(ground, x: float, y: float) -> tuple[int, int]:
    row, col = ground.surface.index(x, y)
    return row - 7, col - 7


def ground_mask(z: np.ndarray, slip: np.ndarray = FREE, limits: Limits | None = None) -> np.ndarray:
    """Mask of the ground alone about the middle of the map."""
    ground = ground_of(z)
    return mask_window(ground, z.shape[0] // 2 - 7, z.shape[1] // 2 - 7, slip, limits or Limits(), None)


def test_names_follow_the_bits() -> None:
    assert REASONS == ("reach", "collision", "unknown", "steep", "slip", "unlearned")
    assert [reason.value for reason in Reason] == [1, 2, 4, 8, 16, 32]


def test_flat_ground_is_free() -> None:
    assert (ground_mask(flat()) == 0).all()


def test_slip_over_the_limit_and_artefacts_of_a_fit() -> None:
    slip = FREE.copy()
    slip[0, 0], slip[1, 1], slip[2, 2], slip[3, 3] = 0.41, np.nan, -0.01, 1.01
    mask = ground_mask(flat(), slip)
    assert mask[0, 0] == Reason.SLIP
    assert mask[1, 1] == mask[2, 2] == mask[3, 3] == Reason.UNKNOWN
    assert np.count_nonzero(mask) == 4


def test_steep_ground() -> None:
    x = CELL * np.arange(200)
    for slope, expected in ((0.85, 0), (0.95, int(Reason.STEEP))):
        assert (ground_mask(np.tile(slope * x, (160, 1))) == expected).all()


def test_foot_wedged_at_the_foot_of_a_step() -> None:
    z = flat()
    z[:, 100:] = 0.03
    mask = ground_mask(z, limits=Limits(slope=100.0))
    assert (mask[:, 6] == Reason.COLLISION).all()  # the cell beside the wall: the sphere would hang on its edge
    assert (mask[:, :6] == 0).all()
    assert (mask[:, 7:] == 0).all()


def test_unknown_and_outside() -> None:
    z = flat()
    z[80, 100] = np.nan
    ground = ground_of(z)
    mask = mask_window(ground, 73, 93, FREE, Limits(), None)
    assert mask[7, 7] == Reason.UNKNOWN
    outside = mask_window(ground, -100, 1000, FREE, Limits(), None)
    assert (outside == Reason.UNKNOWN).all()


@pytest.mark.parametrize("leg", [0, 4])
@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.1, -0.15, 0.8)])
def test_reach_equals_inverse_kinematics_at_both_ends(leg: int, tilt: tuple[float, float, float]) -> None:
    robot, ground = ragno(), ground_of(flat())
    rot = matrix_from_rpy(*tilt)
    w, x, y, z = quat_from_matrix(rot)
    base = TrunkPose((0.0113, -0.0207, 0.09), (float(w), float(x), float(y), float(z)))
    foot = rot @ neutral(leg)
    placed = placement(robot, leg, base, STROKE)
    slip = np.full((61, 61), 0.04, dtype=np.float32)
    row, col = ground.surface.index(base.position[0] + foot[0], base.position[1] + foot[1])
    mask = mask_window(ground, row - 30, col - 30, slip, Limits(reach_margin=0.0), placed)
    assert 0 < np.count_nonzero(mask & Reason.REACH) < mask.size
    for i in range(61):
        for j in range(61):
            px, py = ground.surface.centre(row - 30 + i, col - 30 + j)
            foot_map = np.array([px, py, robot.foot_radius])
            ends = (np.array(base.position), np.array(base.position) - np.array(STROKE))
            reached = all(leg_ik(robot.model, leg, rot.T @ (foot_map - end))[1] for end in ends)
            assert bool(mask[i, j] & Reason.REACH) != reached, (i, j)


def test_margin_takes_cells_away_never_adds() -> None:
    robot, ground = ragno(), ground_of(flat())
    placed = placement(robot, 0, standing(), STROKE)
    row, col = about(ground, *neutral(0)[:2])
    reached = [
        mask_window(ground, row, col, FREE, Limits(reach_margin=m), placed) & Reason.REACH == 0
        for m in (0.0, 0.01, 0.02)
    ]
    assert (reached[0] >= reached[1]).all()
    assert (reached[1] >= reached[2]).all()
    assert reached[0].sum() > reached[1].sum() > reached[2].sum() > 0


def test_leg_does_not_pass_through_a_wall() -> None:
    robot = ragno()
    foot = neutral(1)  # the middle left leg reaches out along +y
    z = flat()
    wall = ground_of(z).surface.index(0.0, float(foot[1]) - 0.025)[0]
    z[wall - 1 : wall + 2, :] = 0.12  # between hip and foot, higher than the knee
    ground = ground_of(z)
    placed = placement(robot, 1, standing(), (0.0, 0.0, 0.0))
    row, col = about(ground, float(foot[0]), float(foot[1]))
    mask = mask_window(ground, row, col, FREE, Limits(), placed)
    assert mask[7, 7] == Reason.COLLISION
    low = ground_of(flat())
    assert mask_window(low, row, col, FREE, Limits(), placed)[7, 7] == 0


def test_counts() -> None:
    mask = np.array([[0, 1, 3], [4, 56, 0]], dtype=np.uint8)
    counts = np.zeros(7, dtype=np.int64)
    count_reasons(mask, counts)
    assert counts.tolist() == [2, 1, 1, 1, 1, 1, 2]


def test_gradient_of_a_plane_and_at_the_border() -> None:
    x, y = np.meshgrid(CELL * np.arange(5), CELL * np.arange(4))
    surface = ground_of(0.3 * x - 0.7 * y).surface
    assert gradient(surface.z, CELL, 1, 2) == pytest.approx((0.3, -0.7), abs=1e-5)
    for row, col in ((0, 2), (3, 2), (1, 0), (1, 4), (-5, 90)):
        assert all(math.isnan(value) for value in gradient(surface.z, CELL, row, col))
