"""Gaits of a hexapod: which legs swing together and in which order.

A biped's gait is another kind of plan (ZMP); it will stand beside this module, behind the same `step` of a walker.
"""

from dataclasses import dataclass

LF, LM, LH, RF, RM, RH = range(6)


@dataclass(frozen=True, slots=True)
class GaitPattern:
    """Groups of legs that swing in turn; the others stand."""

    name: str
    groups: tuple[tuple[int, ...], ...]
    careful: str | None = None
    """Name of a gait that lifts fewer legs at a time, taken when a step is not safe; None = there is none."""

    @property
    def steps_per_cycle(self) -> int:
        """Steps until every leg has swung once."""
        return len(self.groups)

    @property
    def lead(self) -> float:
        """Distance ahead of neutral at which a foot lands, in steps of the trunk.

        A stance lasts `steps_per_cycle - 1` steps; landing half of that way ahead centres the stance on neutral.
        """
        return 0.5 * (len(self.groups) - 1)


TRIPOD = GaitPattern("tripod", ((LF, LH, RM), (LM, RF, RH)), careful="ripple")
RIPPLE = GaitPattern("ripple", ((LH, RF), (LM, RH), (LF, RM)), careful="wave")
WAVE = GaitPattern("wave", ((LH,), (LM,), (LF,), (RH,), (RM,), (RF,)))

HEXAPOD_GAITS: dict[str, GaitPattern] = {gait.name: gait for gait in (TRIPOD, RIPPLE, WAVE)}
