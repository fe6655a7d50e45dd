"""Match of a robot's joints and legs with the names that other software gives them."""

from collections.abc import Sequence

from surefoot.errors import SurefootError
from surefoot.nearest import did_you_mean
from surefoot.robot.description import Robot


def plain(name: str) -> str:
    """Return a joint or leg name in lower case without the suffix `_joint`, as robot descriptions write it."""
    return name.lower().removesuffix("_joint")


def joint_order(names: Sequence[str], robot: Robot) -> list[int] | None:
    """Return the index in `names` of each joint of the robot, by its names here or in other software; None: one lacks.

    Case and the suffix `_joint` do not matter; names here come first, and names of both kinds are not mixed.
    """
    found = [plain(name) for name in names]
    others = [robot.other_names.get(name, name) for name in robot.joint_names]
    for known in (robot.joint_names, others):
        wanted = [plain(name) for name in known]
        if all(name in found for name in wanted):
            return [found.index(name) for name in wanted]
    return None


def joint_columns(names: Sequence[str], robot: Robot) -> list[int]:
    """Return the index in `names` of each joint of the robot (raises SurefootError: one is absent or there twice)."""
    found = [plain(name) for name in names]
    twice = sorted({name for name in found if found.count(name) > 1})
    if twice:
        raise SurefootError("invalid", f"joint {twice[0]!r} is there more than once", "joint-names")
    order = joint_order(names, robot)
    for name in robot.joint_names if order is None else ():
        if plain(name) not in found:
            hint = did_you_mean(name, names) or f"; it has {', '.join(names)}"
            text = f"no joint {name!r} of {robot.name}{hint};"
            text += " another robot, or name them by --joint-names (`joints` of a driver)"
            raise SurefootError("invalid", text, "joint-names")
    return order or []


def leg_columns(names: Sequence[str], robot: Robot) -> list[int]:
    """Return the index in `names` of each leg of the robot (raises SurefootError: one is absent or there twice)."""
    found = [plain(name).removesuffix("_foot") for name in names]
    twice = sorted({name for name in found if found.count(name) > 1})
    if twice:
        raise SurefootError("invalid", f"foot {twice[0]!r} is there more than once", "feet")
    for leg in robot.leg_names:
        if leg not in found:
            hint = did_you_mean(leg, found) or f"; got {', '.join(found)}"
            raise SurefootError("invalid", f"no foot {leg!r} of {robot.name}{hint}", "feet")
    return [found.index(leg) for leg in robot.leg_names]
