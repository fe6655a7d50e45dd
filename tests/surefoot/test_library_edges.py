"""Edges of the library: regions without bounds, legs with a common motor, names of files, words that are not known."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import surefoot
from surefoot.errors import FieldError, SurefootError
from surefoot.robot import kinematics
from surefoot.robot.reach import KNEE, why_missed

WALLS = {
    "a line": ([(-0.4, 0.0, 0.0), (0.4, 0.0, 0.0)], [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]),
    "a half-plane": (
        [(-0.4, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.2, 0.0)], [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)],
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "com", "expected"),
    [
        ("a line", (0.0, 0.0), 0.0), ("a line", (3.0, 0.0), 0.0), ("a line", (0.0, 0.3), -math.inf),
        ("a half-plane", (0.0, 0.1), 0.1), ("a half-plane", (0.2, 0.35), 0.35),
        ("a half-plane", (0.0, -0.01), -math.inf),
    ],
)  # fmt: skip
def test_a_region_between_walls_has_an_edge_though_no_bound(
    name: str, com: tuple[float, float], expected: float
) -> None:
    """Two walls hold a trunk on the line through both contacts; ground beside it, on its side of the line."""
    points, normals = WALLS[name]
    feet = surefoot.stability.contacts(points, normals)
    assert surefoot.stability.region(feet).status == "unbounded"
    assert surefoot.stability.margin(feet, com) == pytest.approx(expected, abs=1e-6)
    assert (surefoot.stability.forces(feet, com) is None) == (expected == -math.inf)


def test_what_is_left_between_walls_when_a_contact_lifts_is_the_margin_without_it() -> None:
    points, normals = WALLS["a half-plane"]
    feet = surefoot.stability.contacts([*points, (0.0, 0.5, 0.0)], [*normals, (0.0, 0.0, 1.0)])
    expected = [surefoot.stability.margin(feet.without(i), (0.0, 0.1)) for i in range(4)]
    assert expected[2:] == pytest.approx([0.1, 0.1], abs=1e-6)
    assert surefoot.stability.lifts(feet, (0.0, 0.1)) == pytest.approx(expected, abs=1e-7)
    one = surefoot.stability.contacts([(0.0, 0.0, 0.0)])
    assert surefoot.stability.lifts(one, (0.0, 0.0)) == [-math.inf]


def test_between_walls_no_place_has_a_margin_that_nothing_holds() -> None:
    rng, held = np.random.default_rng(5), 0
    for _ in range(120):
        n = int(rng.integers(3, 6))
        side = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
        points, normals = rng.uniform(-0.5, 0.5, (n, 3)), np.zeros((n, 3))
        points[:, 0], normals[:, 0] = -0.4 * side, side
        feet = surefoot.stability.contacts(points, normals, rng.uniform(0.3, 1.0, n))
        com = points[:, :2].mean(axis=0) + rng.normal(0.0, 0.1, 2)
        found = surefoot.stability.margin(feet, com)
        assert (found >= 0.0) == (surefoot.stability.forces(feet, com) is not None)
        if 0.0 < found < math.inf:
            held += 1
            for angle in rng.uniform(0.0, 2.0 * math.pi, 8):
                inside = com + 0.99 * found * np.array((math.cos(angle), math.sin(angle)))
                assert surefoot.stability.forces(feet, inside) is not None
    assert held > 3


def test_legs_that_share_a_motor_are_refused_places_that_they_miss() -> None:
    """The hips of the Nao turn by one motor: a foot put elsewhere alone would move the other one."""
    nao = surefoot.robots.load("nao")
    feet = surefoot.robots.feet(nao, surefoot.robots.stance(nao))
    turned = feet + np.array(((0.03, 0.02, 0.0), (0.0, 0.0, 0.0)))
    with pytest.raises(FieldError, match=r"misses by|out of reach"):
        surefoot.robots.joints(nao, turned)


def test_a_place_that_only_the_other_bend_or_side_reaches_is_refused_for_that() -> None:
    """Knee down, or the foot behind the first axis: the angles exist, and the closed form has others."""
    ragno = surefoot.robots.load("ragno")
    behind = surefoot.robots.feet(ragno, np.tile([0.5, -0.8, -2.0], 6))
    with pytest.raises(FieldError, match="out of reach of leg lf within its joint limits, as its foot always stays"):
        surefoot.robots.joints(ragno, behind)
    far = surefoot.robots.feet(ragno, surefoot.robots.stance(ragno)) + 1.0
    with pytest.raises(FieldError, match=r"out of reach of leg lf within its joint limits$"):
        surefoot.robots.joints(ragno, far)
    loose = ragno.model._replace(upper=np.full(18, 2.0), lower=np.tile([-1.0, -0.5, -0.5], 6))
    down = kinematics.foot_positions(loose, np.tile([0.0, 0.2, 0.9], 6))
    assert why_missed(loose, 0, down[0]) == KNEE
    with pytest.raises(FieldError, match=r"leg left_leg .*by steps from the neutral stance"):
        surefoot.robots.joints(surefoot.robots.load("bioloid"), np.full((2, 3), 1.0))


def test_maps_whose_names_have_a_dot_do_not_overwrite_each_other(tmp_path: Path) -> None:
    maps = [surefoot.terrain.HeightMap(np.full((3, 3), z, dtype=np.float32), 0.1, (0.0, 0.0)) for z in (0.0, 1.0)]
    names = [surefoot.terrain.save(each, tmp_path / f"ground_0.{k}5") for k, each in enumerate(maps)]
    assert [name.name for name in names] == ["ground_0.05.npz", "ground_0.15.npz"]
    assert sorted(each.name for each in tmp_path.glob("*.json")) == ["ground_0.05.json", "ground_0.15.json"]
    assert [float(surefoot.terrain.load(name).z[0, 0]) for name in names] == [0.0, 1.0]


LEVEL: Any = surefoot.terrain.HeightMap(np.eye(5, dtype=np.float32), 0.1, (0.0, 0.0))
FLOOR: Any = surefoot.navigation.FloorGrid(np.zeros((4, 5), dtype=np.int8), 0.1)
THREE = np.array([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.0]])
UP = np.tile([0.0, 0.0, 1.0], (3, 1))


def hand_made(position: object = THREE, normal: object = UP, mu: object = (0.5, 0.5, 0.5)) -> float:
    made = surefoot.stability.ContactSet(position, normal, mu)  # type: ignore[arg-type]
    return surefoot.stability.margin(made, (0.0, 0.0))


@pytest.mark.parametrize(
    ("call", "field", "text"),
    [
        (lambda: LEVEL.index(math.nan, 0.0), "x", "got nan, expected finite numbers in m"),
        (lambda: LEVEL.index(0.0, math.inf), "y", "got inf, expected finite numbers in m"),
        (lambda: LEVEL.index("a", 0.0), "x", "got 'a', expected numbers in m"),
        (lambda: LEVEL.index(0.0, (1.0, 2.0)), "y", "got shape (2,), expected one number in m"),
        (lambda: LEVEL.patch("a", 0.0, 3), "x, y", "expected numbers in m"),
        (lambda: LEVEL.patch(0.0, 0.0, 3.0), "n", "got 3.0, expected a whole number"),
        (lambda: LEVEL.patch(0.0, 0.0, 10**6 + 1), "n", "got 1000001, allowed is 1 to 3999"),
        (lambda: LEVEL.patch(0.0, 0.0, math.nan), "n", "got nan, expected a whole number"),
        (lambda: LEVEL.with_z([[0.0, 1.0]]), "z", "must keep the shape (5, 5), got (1, 2)"),
        (lambda: LEVEL.with_z("a"), "z", "got 'a', expected numbers in m"),
        (lambda: LEVEL.with_z(np.eye(5) * 1j), "z", "expected numbers in m"),
        (lambda: LEVEL.with_z(LEVEL.z, version=1.5), "version", "got 1.5, expected a whole number"),
        (lambda: LEVEL.inside("a", 0), "row", "got 'a', expected a whole number"),
        (lambda: LEVEL.inside(0, math.nan), "col", "got nan, expected a whole number"),
        (lambda: LEVEL.centre(np.zeros(2), 0), "row", "expected a whole number"),
        (lambda: LEVEL.centre(0, None), "col", "got None, expected a whole number"),
        (lambda: FLOOR.inside(0.5, 0), "row", "got 0.5, expected a whole number"),
        (lambda: FLOOR.inside(0, [0]), "col", "expected a whole number"),
        (lambda: FLOOR.centre("a", 0), "row", "got 'a', expected a whole number"),
        (lambda: FLOOR.centre(0, math.nan), "col", "got nan, expected a whole number"),
        (lambda: hand_made(normal=2.0 * UP), "where.normal", "got [0.0, 0.0, 2.0], expected a unit normal"),
        (lambda: hand_made(mu=(0.5, -0.5, 0.5)), "where.mu", "got -0.5 at [1], allowed is 0 to 10000, or inf"),
        (lambda: hand_made(mu=(0.5, math.nan, 0.5)), "where.mu", "got nan at [1]"),
        (lambda: hand_made(100.0 * THREE), "where.position", "got points 20 apart, allowed are 10 m; are these mill"),
        (lambda: hand_made(np.zeros((65, 3)), np.zeros((65, 3)), np.ones(65)), "where", "got 65 contacts, at most 64"),
        (lambda: surefoot.stability.contacts(THREE, friction=[0.5, [0.5]]), "friction", "expected numbers"),
    ],
)  # fmt: skip
def test_what_is_no_place_of_a_map_and_no_contact_is_refused_with_its_value(
    call: Callable[[], object], field: str, text: str
) -> None:
    with pytest.raises(FieldError) as refused:
        call()
    assert refused.value.field == field
    assert text in str(refused.value)


@pytest.mark.parametrize(
    ("call", "field", "text"),
    [
        (lambda: surefoot.navigation.Clearance(through_unknown="no"), "through_unknown", "got 'no', expected True or"),  # type: ignore[arg-type]
        (lambda: surefoot.navigation.Clearance(through_unknown=math.nan), "through_unknown", "got nan"),  # type: ignore[arg-type]
        (lambda: surefoot.navigation.Clearance(exact=[]), "exact", "got [], expected True or False"),  # type: ignore[arg-type]
        (lambda: surefoot.navigation.FloorGrid(FLOOR.cells, 0.1, source=math.nan), "source", "got nan, expected a"),  # type: ignore[arg-type]
        (lambda: surefoot.navigation.FloorGrid(FLOOR.cells, 0.1, source=b"x"), "source", "expected a text"),  # type: ignore[arg-type]
        (lambda: FLOOR.from_bytes(b"\0", "1", 1, 0.1, (0, 0)), "rows", "got '1', expected a whole number"),
        (lambda: FLOOR.from_bytes(b"\0", 1, math.nan, 0.1, (0, 0)), "cols", "got nan, expected a whole number"),
        (lambda: FLOOR.from_bytes("x", 1, 1, 0.1, (0, 0)), "data", "got 'x', expected bytes"),
    ],
)  # fmt: skip
def test_what_is_no_flag_and_no_text_of_a_map_is_refused(call: Callable[[], object], field: str, text: str) -> None:
    with pytest.raises(SurefootError) as refused:
        call()
    assert refused.value.field == field
    assert text in str(refused.value)


def test_cells_of_numpy_are_cells_and_an_origin_is_kept_as_numbers() -> None:
    row, col = np.argwhere(LEVEL.z == 1.0)[2]
    assert LEVEL.inside(row, col)
    assert LEVEL.centre(row, col) == LEVEL.centre(2, 2)
    assert not FLOOR.inside(np.int64(4), np.int64(0))
    assert FLOOR.centre(np.int64(1), np.int64(2)) == FLOOR.centre(1, 2)
    assert surefoot.navigation.FloorGrid(FLOOR.cells, 0.1, np.ones(2)).origin == (1.0, 1.0)  # type: ignore[arg-type]


def test_places_far_outside_of_a_map_are_allowed() -> None:
    assert LEVEL.index(1e300, 0.0)[1] > 1e300
    assert np.isnan(LEVEL.patch(1e300, 0.0, 3)).all()
    assert (LEVEL.with_z(np.zeros((5, 5)).tolist()).z == 0.0).all()  # pyright: ignore[reportArgumentType]
    assert hand_made(THREE.tolist(), UP.tolist()) == hand_made()


def test_a_grid_that_no_plan_takes_is_refused_by_both() -> None:
    free = np.zeros((30, 30), dtype=np.int8)
    fine = surefoot.terrain.HeightMap(np.zeros((30, 30), dtype=np.float32), 9e-4)
    for call, field in (
        (lambda: surefoot.navigation.grid(free, 9e-4), "cell"),
        (lambda: surefoot.navigation.grid(fine), "source.cell"),
        (
            lambda: surefoot.navigation.plan(surefoot.navigation.FloorGrid(free, 9e-4), (0.0, 0.0), (0.01, 0.01)),
            "floor",
        ),
    ):
        with pytest.raises(FieldError, match=r"got 0.0009, allowed is 0.001 to 10 m") as refused:
            call()
        assert refused.value.field.startswith(field)
    smallest = surefoot.navigation.grid(free, 1e-3)
    route = surefoot.navigation.plan(smallest, (0.01, 0.01), (0.02, 0.02), radius=0.0)
    assert route.length == pytest.approx(0.01 * math.sqrt(2.0), abs=1e-3)


TURNS = np.tile(np.eye(3), (4, 1, 1))
SAMPLE = surefoot.estimation.ExternalSample(yaw=0.0, yaw_variance=1.0)


def live(refused: str = "raise") -> surefoot.estimation.Estimator:
    return surefoot.estimation.estimator(feet=4, refused=refused)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "field", "text"),
    [
        (lambda: live().feet(0, np.full((4, 3), 200.0), TURNS), "feet", "position[0, 0] = 200 m, allowed are"),
        (lambda: live().feet(0, np.zeros((4, 3)), 0.0 * TURNS), "feet", "got rot[0] = [[0.0, 0.0, 0.0]"),
        (lambda: live().feet(0, np.zeros((4, 3)), -TURNS), "feet", "allowed are rotations: rows of length 1"),
        (lambda: live().feet(0, np.zeros((4, 3)), 1e200 * TURNS), "feet", "got rot[0] = [[1e+200"),
        (lambda: live().imu(0, (0, 0, 0), (0, 0, 9.8), b"x"), "clipped", "got b'x', expected True or False"),  # type: ignore[arg-type]
        (lambda: live("count").imu("a", (0, 0, 0), (0, 0, 9.8)), "stamp_ns", "got 'a'"),  # type: ignore[arg-type]
        (lambda: live("count").imu(0.5, (0, 0, 0), (0, 0, 9.8)), "stamp_ns", "got 0.5"),  # type: ignore[arg-type]
        (lambda: live("count").feet(None, np.zeros((4, 3)), TURNS), "stamp_ns", "got None"),  # type: ignore[arg-type]
        (lambda: live("count").external(0, None), "external", "got None, expected an ExternalSample"),  # type: ignore[arg-type]
        (lambda: live("count").external("a", SAMPLE), "stamp_ns", "got 'a'"),  # type: ignore[arg-type]
        (lambda: live("count").estimate(np.zeros((2, 2))), "name", "expected the name of an estimator"),  # type: ignore[arg-type]
        (lambda: surefoot.estimation.estimator(feet=4, names=("inekf",)), "names", "which only `estimation.run` has"),
        (lambda: surefoot.bags.messages("no.mcap", ["state/velocity"]), "keys", "got ['state/velocity']"),  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_what_is_no_sample_is_refused_at_the_border(call: Callable[[], object], field: str, text: str) -> None:
    with pytest.raises(FieldError) as refused:
        call()
    assert refused.value.field == field
    assert text in str(refused.value)


def test_unknown_feet_and_rotations_of_few_digits_are_taken() -> None:
    turn = np.array([[0.707, -0.707, 0.0], [0.707, 0.707, 0.0], [0.0, 0.0, 1.0]])
    for rot in (np.tile(turn, (4, 1, 1)), np.full((4, 3, 3), math.nan)):
        one = live("count")
        assert one.imu(0, (0, 0, 0), (0, 0, 9.8), True) is surefoot.estimation.InputResult.SATURATED
        assert one.feet(0, np.zeros((4, 3)), rot) is live().feet(0, np.zeros((4, 3)), np.tile(turn, (4, 1, 1)))
    assert set(surefoot.estimation.names()) > {"best", "inekf"}


def test_an_unknown_interpolation_is_refused() -> None:
    ground = surefoot.terrain.HeightMap(np.eye(2, dtype=np.float32), 0.1, (0.0, 0.0))
    with pytest.raises(FieldError, match=r"got 'cubic', known are bilinear, nearest"):
        ground.height(0.0, 0.0, "cubic")  # pyright: ignore[reportArgumentType]


def test_a_noise_below_zero_is_refused_before_the_log_is_read() -> None:
    with pytest.raises(FieldError, match=r"sigma_w.*-1.*0") as caught:
        surefoot.estimation.run("nothing.npz", sigma_w=-1.0)
    assert caught.value.field == "sigma_w"


SAVED = surefoot.terrain.generate("flat")
RAGGED = [np.zeros((2, 2)), np.zeros((2, 3))]
LONG = "r" * 5000
ODD: list[tuple[Callable[[], object], str, str]] = [
    (lambda: surefoot.terrain.save(SAVED, "/"), "path", "'/'"),
    (lambda: surefoot.terrain.save(SAVED, "."), "path", "'.'"),
    (lambda: surefoot.terrain.save(SAVED, "m", seed=2**64), "seed", str(2**64)),
    (lambda: surefoot.terrain.save(SAVED, "m", file="a"), "file", "'a'"),
    (lambda: surefoot.terrain.save(SAVED, "m", origin="lab"), "origin", "'lab'"),
    (lambda: SAVED.centre(10**400, 0), "row", "1000"),
    (lambda: SAVED.centre(0, -(10**400)), "col", "-1000"),
    (lambda: SAVED.dilated(1e300), "radius", "1e+300"),
    (lambda: SAVED.dilated(4096.0), "radius", "4096"),
    (lambda: surefoot.navigation.grid(np.zeros((9, 9)), origin=RAGGED), "origin", "numbers"),  # type: ignore[arg-type]
    (lambda: surefoot.terrain.load("a\nb.npz"), "path", "a\\nb.npz"),
    (lambda: surefoot.bags.info("a\udc80\x1b[2J.mcap"), "", "a\\udc80\\x1b[2J.mcap"),
    (lambda: surefoot.bags.check(LONG), "path", "no such file"),
    (lambda: surefoot.bags.check("/"), "path", "is a folder"),
    (lambda: surefoot.simulation.run(LONG), "", "no scenario is named"),
    (lambda: surefoot.terrain.slip_model(LONG), "", "cannot be read"),
]


@pytest.mark.parametrize(("call", "field", "text"), ODD, ids=[f"odd-{i}" for i in range(len(ODD))])
def test_odd_values_that_had_raised_other_errors_are_refused_in_one_line(
    call: Callable[[], object], field: str, text: str
) -> None:
    with pytest.raises(SurefootError) as refused:
        call()
    assert refused.value.field in (field, field or None)
    assert text in str(refused.value)
    assert str(refused.value).isprintable()


def test_an_amplitude_of_minus_zero_is_level_ground() -> None:
    assert (surefoot.terrain.generate("rough", amplitude=-0.0).z == surefoot.terrain.generate("flat").z).all()


def test_a_stance_that_is_refused_is_named_in_one_line() -> None:
    world = surefoot.simulation.world()
    with pytest.raises(SurefootError, match="stance") as refused:
        world.reset(stance=np.ones(18))
    assert str(refused.value).isprintable()
    assert "\\n" not in str(refused.value)
