"""The proofs of a margin, and the audit of a walk: what was claimed is proved, what was changed is contradicted."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.lab.audit import proof
from surefoot.lab.audit.walk import audit, level, proved
from surefoot.record.recording import RecordingWriter
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import JointState
from surefoot.schemas.stability import StabilityStatus
from surefoot.schemas.topics import HW_JOINTS, STATE_STABILITY, STATE_VELOCITY
from surefoot.services.stability.sensing.state import WatchParams, watch
from tests.surefoot.toys import estimate

SQUARE = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
UP = np.tile((0.0, 0.0, 1.0), (4, 1))


def test_forces_prove_that_a_point_is_held_and_nothing_else_does() -> None:
    quarter = 0.25 * UP
    assert proof.holds(SQUARE, UP, 0.5, quarter, np.zeros(2))
    assert not proof.holds(SQUARE, UP, 0.5, quarter, np.array([0.01, 0.0]))
    pulled = quarter.copy()
    pulled[:2, 2], pulled[2:, 2] = (0.75, -0.25), (0.25, 0.25)
    assert not proof.holds(SQUARE, UP, 0.5, pulled, np.array([1.0, 0.5]))  # a foot would pull
    across = quarter + np.array([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]] * 2)
    assert not proof.holds(SQUARE, UP, 0.5, across, np.zeros(2))  # beyond its cone
    assert not proof.holds(SQUARE, UP, 0.5, 1.1 * quarter, np.zeros(2))  # not its weight


def test_a_twist_proves_the_edge_of_the_feet_and_a_wrong_one_nothing() -> None:
    east = np.array([1.0, 0.0])
    edge = np.array([0.0, 0.0, 1.0, 0.0])  # about the line x = 1
    assert proof.bounds(SQUARE, UP, 0.5, edge, east) == pytest.approx(1.0)
    assert proof.bounds(SQUARE, UP, 0.5, np.array([0.0, 0.0, 0.9, 0.0]), east) == np.inf
    assert proof.bounds(SQUARE, UP, 0.5, np.array([0.1, 0.0, 1.0, 0.0]), east) == np.inf  # slides at x = 1


def test_the_hull_of_held_points_is_held() -> None:
    held = [np.array(p) for p in itertools.product((-1.0, 1.0), repeat=2)]
    assert proof.inside([*held, np.zeros(2)], np.array([0.25, 0.5])) == pytest.approx(0.5)
    assert proof.inside(held, np.array([1.01, 0.0])) == -np.inf
    assert proof.inside(held[:2], np.zeros(2)) == -np.inf


@pytest.mark.parametrize("seed", range(4))
def test_proofs_of_a_stance_bracket_the_margin_of_the_service(seed: int) -> None:
    robot, rng = load_robot("ragno"), np.random.default_rng(seed)
    q = np.array(robot.neutral) + rng.normal(0.0, 0.1, robot.nj)
    g_up = rng.normal(0.0, 0.5, 3) + np.array([0.0, 0.0, GRAVITY])
    stance = np.array([True, False, True, True, False, True])
    now = watch(robot, q, stance, g_up, None, WatchParams())
    points, centre = level(robot, q, g_up, stance)
    np.testing.assert_allclose(centre, now.com_planned, atol=1e-12)
    least, most = proved(robot, points, WatchParams().mu, centre)
    claimed = now.margin_planned.value
    assert claimed is not None
    assert most >= claimed - 1e-9
    assert least <= claimed + 1e-3


def recording(path: Path, change: float = 0.0) -> Path:
    """A robot that stands on four feet; its second claim is ``change`` off, m."""
    robot = load_robot("ragno")
    q, g_up = np.array(robot.neutral), np.array([0.3, 0.0, GRAVITY])
    stance = np.array([True, True, False, True, True, True])
    now = watch(robot, q, stance, g_up, None, WatchParams())
    writer = RecordingWriter(path, {"robot": "ragno"})
    for tick in range(0, 6, 2):
        header = (tick * 10**7, tick, 1, tick, "x")
        margin = float(now.margin_planned.value or 0.0) + (change if tick == 2 else 0.0)
        x, y = now.com_planned.tolist()
        status = StabilityStatus(
            status="ok", stance=tuple(stance.tolist()), region=(), com_planned=(x, y), com_measured=None,
            margin_planned=margin, margin_measured=None, mu=WatchParams().mu,
        )  # fmt: skip
        velocity = estimate(0.0).model_copy(update={"g_up": tuple(g_up.tolist())})
        joints = JointState(position=tuple(q.tolist()))
        for topic, message in ((HW_JOINTS, joints), (STATE_VELOCITY, velocity), (STATE_STABILITY, status)):
            stamped = message.stamped(*header)
            writer.write(topic, stamped, Raw(*encode(stamped), encoding_of(type(stamped))))
    writer.close({})
    return path


def test_an_honest_recording_is_proved_and_a_changed_margin_contradicted(tmp_path: Path) -> None:
    honest = audit(recording(tmp_path / "a.mcap"))
    assert [claim.proved for claim in honest.claims] == [True] * 3
    assert honest.contradicted == ()
    for change in (0.01, -0.01):
        changed = audit(recording(tmp_path / "b.mcap", change))
        assert [claim.tick for claim in changed.contradicted] == [2]


def test_the_command_ends_with_what_it_found(tmp_path: Path, in_process) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = in_process("audit", recording(tmp_path / "a.mcap"))
    assert (code, "3 margins claimed, 3 proved" in out) == (0, True)
    code, out, _ = in_process("audit", recording(tmp_path / "b.mcap", 0.05))
    assert (code, "1 contradicted" in out) == (1, True)


def test_a_recording_without_claims_is_refused(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "empty.mcap", {"robot": "ragno"})
    writer.close({})
    with pytest.raises(SurefootError):
        audit(tmp_path / "empty.mcap")
