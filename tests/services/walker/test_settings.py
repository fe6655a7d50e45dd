"""Numbers of `[gait]`: each within its range, none unknown, none missing; every shipped robot has a valid table."""

import dataclasses

import pytest

from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot, robot_names
from surefoot.services.walker.biped.params import BipedParams
from surefoot.services.walker.legged.params import WalkerParams

LUPO = load_robot("lupo")
KINDS = {"lupo": WalkerParams, "nao": BipedParams}


def limited(model) -> list[tuple[str, float]]:
    """Each numeric field of a model with a value just outside its range, on either side."""
    found = []
    for name, field in model.model_fields.items():
        for part in field.metadata:
            for limit, away in (("gt", 0.0), ("ge", -1e-6), ("le", 1e-6), ("lt", 0.0)):
                if (edge := getattr(part, limit, None)) is not None:
                    found.append((name, edge + away * max(1.0, abs(edge))))
    return found


@pytest.mark.parametrize("name", robot_names())
def test_shipped_robots_have_a_valid_gait(name: str) -> None:
    robot = load_robot(name)
    kind = BipedParams if robot.kind == "biped" else WalkerParams
    assert {key: getattr(kind.for_robot(robot), key) for key in robot.gait} == robot.gait


@pytest.mark.parametrize("name", KINDS)
def test_every_number_has_a_lower_and_an_upper_limit_and_is_refused_outside(name: str) -> None:
    kind, robot = KINDS[name], load_robot(name)
    outside = limited(kind)
    numbers = {field for field, one in kind.model_fields.items() if one.annotation in (float, int)}
    assert {field for field, _ in outside} == numbers
    assert len(outside) == 2 * len(numbers)
    counts = {field for field in numbers if kind.model_fields[field].annotation is int}  # a file has them as 2.0
    wrong = [(field, value) for field in numbers - counts for value in (True, "1")]
    for field, value in [*outside, *wrong, *((field, float("nan")) for field in numbers)]:
        with pytest.raises(RobotError, match=rf"^gait\.{field}: got .*; ") as caught:
            kind.for_robot(dataclasses.replace(robot, gait={**robot.gait, field: value}))
        assert caught.value.field == f"gait.{field}"


@pytest.mark.parametrize("name", KINDS)
def test_an_unknown_name_is_refused_and_the_near_one_suggested(name: str) -> None:
    robot = load_robot(name)
    with pytest.raises(RobotError, match=r"^gait\.sagg: is not known here \(did you mean 'sag'\?\); known are"):
        KINDS[name].for_robot(dataclasses.replace(robot, gait={**robot.gait, "sagg": 1.0}))


@pytest.mark.parametrize("name", KINDS)
def test_a_number_that_the_robot_alone_can_state_is_missed_by_name(name: str) -> None:
    kind, robot = KINDS[name], load_robot(name)
    own = [field for field, one in kind.model_fields.items() if one.is_required()]
    assert set(own) <= set(robot.gait)
    for field in own:
        less = {key: value for key, value in robot.gait.items() if key != field}
        with pytest.raises(RobotError, match=rf"^gait\.{field}: is missing"):
            kind.for_robot(dataclasses.replace(robot, gait=less))
        assert getattr(kind.for_robot(dataclasses.replace(robot, gait=less), **{field: robot.gait[field]}), field)


def test_a_count_is_a_whole_number() -> None:
    assert WalkerParams.for_robot(dataclasses.replace(LUPO, gait={**LUPO.gait, "max_shifts": 3.0})).max_shifts == 3
    with pytest.raises(RobotError, match=r"^gait\.max_shifts: got 2\.5"):
        WalkerParams.for_robot(dataclasses.replace(LUPO, gait={**LUPO.gait, "max_shifts": 2.5}))
