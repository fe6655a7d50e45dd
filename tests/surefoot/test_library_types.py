"""Values of other types in the library: refused with field and value; other layouts of numbers: the same answers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import surefoot
from surefoot.errors import FieldError, SurefootError

FEET = np.array([[0.125, 0.25, 0.0], [0.125, -0.25, 0.0625], [-0.25, 0.0, 0.03125]])
UPS = np.array([[0.0, 0.0, 1.0], [0.125, 0.0, 1.0], [0.0, -0.25, 1.0]])
HUGE = 10**400
GROUND = surefoot.terrain.generate("rough", 1)
ROOM = surefoot.navigation.grid(np.zeros((20, 20)))
MASKED = np.ma.array([0.0, 0.0, 9.5], mask=[True, False, False])
STAMP = np.timedelta64(1, "s")


def counting() -> surefoot.estimation.Estimator:
    return surefoot.estimation.estimator("ragno", refused="count")


def strict() -> surefoot.estimation.Estimator:
    return surefoot.estimation.estimator("ragno")


def outside(**parts: Any) -> surefoot.estimation.InputResult:
    return counting().external(0, surefoot.estimation.ExternalSample(**{"yaw": 0.0, "yaw_variance": 1.0} | parts))


BAD: list[tuple[Callable[[], object], str, str]] = [
    (lambda: surefoot.stability.contacts(FEET, friction="0.5"), "friction", "'0.5'"),
    (lambda: surefoot.stability.contacts([["0.1", "0.1", "0.0"]]), "points", "0.1"),
    (lambda: surefoot.stability.forces(contacts(), [0, 0], weight=True), "weight", "True"),
    (lambda: surefoot.stability.forces(contacts(), [0, 0], weight=STAMP), "weight", "1"),  # type: ignore[arg-type]
    (lambda: surefoot.stability.margin(by_hand([[0.5], [0.5, 0.5], 0.5]), [0, 0]), "where.mu", "numbers"),
    (lambda: surefoot.robots.load(HUGE), "name", "expected the name"),  # type: ignore[arg-type]
    (lambda: surefoot.robots.load("r" * 300), "name", "ragno"),
    (lambda: surefoot.estimation.estimator(HUGE), "name", "expected the name"),  # type: ignore[arg-type]
    (lambda: surefoot.estimation.run("log.csv", smooth="yes"), "smooth", "'yes'"),  # type: ignore[arg-type]
    (lambda: surefoot.terrain.load("a\0b"), "path", "expected the path"),
    (lambda: surefoot.bags.arrays("a\0b"), "path", "expected the path"),
    (lambda: surefoot.terrain.save(GROUND, "ground", mood=None), "mood", "None"),  # type: ignore[arg-type]
    (lambda: surefoot.terrain.HeightMap([[HUGE]], 0.05), "z", "numbers"),  # type: ignore[arg-type]
    (lambda: GROUND.index("1.0", 0.0), "x", "'1.0'"),  # type: ignore[arg-type]
    (lambda: GROUND.height(["a"], 0.0), "x", "numbers"),
    (lambda: GROUND.height([0.0, 1.0], [0.0, 1.0, 2.0]), "x, y", "(2,)"),
    (lambda: GROUND.height_at(0.0, None), "y", "None"),  # type: ignore[arg-type]
    (lambda: GROUND.dilated("0.01"), "radius", "'0.01'"),  # type: ignore[arg-type]
    (lambda: GROUND.smoothed(None), "min_known", "None"),  # type: ignore[arg-type]
    (lambda: GROUND.smoothed(10), "min_known", "10"),
    (lambda: ROOM.index(float("nan"), 0.0), "x", "nan"),
    (lambda: ROOM.index(0.0, "a"), "y", "'a'"),  # type: ignore[arg-type]
    (lambda: surefoot.simulation.world().displace(0.0, 0.0, 0.0, only_ask="no"), "only_ask", "'no'"),  # type: ignore[arg-type]
    (lambda: strict().imu(0, MASKED, (0, 0, 9.8)), "imu", "got"),
    (lambda: strict().imu(0, ("0", "0", "0"), (0, 0, 9.8)), "imu", "w"),
]


def contacts() -> surefoot.stability.ContactSet:
    return surefoot.stability.contacts(FEET)


def by_hand(mu: object) -> surefoot.stability.ContactSet:
    return surefoot.stability.ContactSet(FEET, np.tile([0.0, 0.0, 1.0], (3, 1)), mu)  # type: ignore[arg-type]


@pytest.mark.parametrize(("call", "field", "shown"), BAD)
def test_values_of_other_types_are_refused_with_field_and_value(
    call: Callable[[], object], field: str, shown: str
) -> None:
    with pytest.raises(SurefootError) as refused:
        call()
    assert refused.value.field == field
    assert shown in str(refused.value)


def test_samples_of_other_types_are_counted_and_do_not_raise() -> None:
    for wrong in (HUGE, "a", b"a", 1j, {"a": 1}, [[0.0], [0.0, 1.0]], np.array([object()]), ["0", "0", "0"]):
        name = counting().imu(0, wrong, (0.0, 0.0, 9.8)).name  # type: ignore[arg-type]
        assert name in ("SHAPE", "NONFINITE")
        assert outside(velocity=wrong, velocity_covariance=np.eye(3)).name in ("SHAPE", "NONFINITE")
        assert outside(yaw=wrong).name in ("SHAPE", "NONFINITE")
    assert counting().imu(0, MASKED, (0.0, 0.0, 9.8)).name == "NONFINITE"
    assert outside(velocity=MASKED, velocity_covariance=np.eye(3)).name == "NONFINITE"
    assert counting().imu(0, np.ma.array([0.0, 0.0, 0.0]), (0.0, 0.0, 9.8)).accepted


LAYOUTS: list[Callable[[np.ndarray], Any]] = [
    lambda a: a.astype(np.float32),
    np.asfortranarray,
    lambda a: a.tolist(),
    lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    lambda a: a[::-1].copy()[::-1],
    lambda a: a.astype(object),
    lambda a: a.astype(">f8"),
    np.ma.asarray,
]


def answers(of: Callable[[np.ndarray], Any]) -> list[np.ndarray]:
    """Return what the library answers to the same numbers, each in the layout `of`."""
    feet = surefoot.stability.contacts(of(FEET), of(UPS), of(np.array([0.5, 0.25, 0.75])))
    com = of(np.array([0.03125, 0.0625]))
    ragno = surefoot.robots.load("ragno")
    q = np.round(surefoot.robots.stance(ragno) * 256.0) / 256.0
    stood = np.round(surefoot.robots.feet(ragno, q) * 4096.0) / 4096.0
    belief = surefoot.navigation.PoseFilter(of(np.array([0.25, 0.5, 0.125])), of(np.diag([0.25, 0.5, 0.125])))
    belief.predict(0.5, 0.0, 0.25, of(np.array([0.125, 0.25, 0.0625])))
    belief.landmark(of(np.array([2.0, 1.0])), 2.0, 0.25, of(np.array([0.25, 0.125])))
    room = surefoot.navigation.grid(of(np.pad(np.zeros((30, 40)), 2, constant_values=100.0)), 0.125)
    live = surefoot.estimation.estimator("ragno")
    for tick in range(20):
        live.imu(10_000_000 * tick, of(np.array([0.0, 0.0625, 0.25])), of(np.array([0.0, 0.25, 9.75])))
        live.joints(10_000_000 * tick, of(q), of(np.ones(6)))
    world = surefoot.simulation.world("ragno")
    world.reset(0, stance=of(q))
    world.step_tick(of(q))
    heights = np.round(GROUND.patch(0.0, 0.0, 41).astype(np.float64) * 1024.0) / 1024.0
    step = surefoot.terrain.foothold(of(heights), 0.005, stroke=of(np.array([0.0625, 0.0, 0.0])), foot_radius=0.008)
    return [
        surefoot.stability.region(feet, directions=of(np.array([[1.0, 0.5], [-1.0, 0.25], [0.0, -2.0]]))).support.value,
        np.array(surefoot.stability.margin(feet, com)), surefoot.stability.lifts(feet, com),
        np.array(surefoot.stability.forces(feet, com)), surefoot.robots.feet(ragno, of(q)),
        surefoot.robots.com(ragno, of(q)), surefoot.robots.joints(ragno, of(stood)), belief.pose, belief.covariance,
        surefoot.navigation.plan(room, of(np.array([0.5, 0.5])), of(np.array([4.0, 3.0]))).waypoints,
        GROUND.height(of(FEET[:, 0]), of(FEET[:, 1])), live.estimate().velocity, live.pose().position,
        world.truth().position, np.array(step.foothold),
    ]  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_numbers_in_other_types_and_layouts_give_the_same_answers(layout: Callable[[np.ndarray], Any]) -> None:
    for plain, other in zip(answers(np.array), answers(layout), strict=True):
        np.testing.assert_array_equal(plain, other)


def test_arguments_are_not_changed_and_may_be_read_only() -> None:
    given = list[np.ndarray]()

    def locked(a: np.ndarray) -> np.ndarray:
        a = a.copy()
        a.flags.writeable = False
        given.append(a)
        return a

    for plain, other in zip(answers(np.array), answers(locked), strict=True):
        np.testing.assert_array_equal(plain, other)
    assert given


def test_flags_of_numpy_are_flags() -> None:
    assert strict().imu(0, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8), np.False_).accepted  # type: ignore[arg-type]
    with pytest.raises(FieldError, match="True or False"):
        strict().imu(0, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8), 2)  # type: ignore[arg-type]
