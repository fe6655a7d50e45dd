"""Gaits of robots with four or six legs: which legs swing together and in which order."""

from dataclasses import dataclass

from surefoot.robot.description import Robot

LF, LM, LH, RF, RM, RH = range(6)


@dataclass(frozen=True, slots=True)
class GaitPattern:
    """Gait: groups of legs that swing in turn, while all other legs stand."""

    name: str
    groups: tuple[tuple[int, ...], ...]
    careful: str | None = None
    """Name of a gait that lifts fewer legs at a time, taken when a step is not safe; None = there is none."""
    leans: bool = False
    """True if the trunk moves over the feet that will stand before a group swings, and rests while it does."""

    @property
    def steps_per_cycle(self) -> int:
        """Number of steps until every leg has swung once."""
        return len(self.groups)

    @property
    def lead(self) -> float:
        """Distance ahead of neutral at which a foot lands, in trunk advances of one step.

        A stance lasts `steps_per_cycle - 1` steps; landing half of that way ahead centres the stance on neutral.
        """
        return 0.5 * (len(self.groups) - 1)


TRIPOD = GaitPattern("tripod", ((LF, LH, RM), (LM, RF, RH)), careful="ripple")
RIPPLE = GaitPattern("ripple", ((LH, RF), (LM, RH), (LF, RM)), careful="wave")
WAVE = GaitPattern("wave", ((LH,), (LM,), (LF,), (RH,), (RM,), (RF,)))

HEXAPOD_GAITS: dict[str, GaitPattern] = {gait.name: gait for gait in (TRIPOD, RIPPLE, WAVE)}


def crawl(robot: Robot) -> GaitPattern:
    """Return the crawl of a robot: one leg at a time, on each side from the hind leg forward.

    Two legs of one side follow each other, so the trunk changes sides twice in a cycle only.
    """
    legs = sorted(range(robot.nlegs), key=lambda i: (robot.legs[i].hip[1] < 0.0, robot.legs[i].hip[0]))
    return GaitPattern("crawl", tuple((leg,) for leg in legs), leans=True)


def gaits_of(robot: Robot) -> dict[str, GaitPattern]:
    """Return the gaits that a robot can walk, by name; the first is its default."""
    return HEXAPOD_GAITS if robot.kind == "hexapod" else {"crawl": crawl(robot)}
