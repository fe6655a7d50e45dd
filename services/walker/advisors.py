"""Requests for footholds and stability before a step; without a reply the walker's own substitutes decide."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import numpy as np

from surefoot.errors import CallError
from surefoot.geometry import rotations
from surefoot.robot.description import Robot
from surefoot.schemas.footholds import BasePose, LegRequest, SelectRequest
from surefoot.schemas.stability import BasePose as CheckBase
from surefoot.schemas.stability import CheckRequest, Contact
from surefoot.schemas.topics import FOOTHOLDS_SELECT, STABILITY_CHECK

from .interface import FootholdReply, LandingRequest, StanceCheck, StanceVerdict
from .legged.standins import HullCheck, nominal_footholds
from .outcomes import Outcomes

ANSWER_S = 1.0
"""Wall time in paced mode after which the walker uses its own stand-in for a missing reply, s; lockstep waits for the
reply."""
REGION_TOLERANCE_M = 1e-3
"""Requested accuracy of the support region in a stability reply, m; the margins in the reply are exact."""


class Call(Protocol):
    """Function that sends a request to another service and waits for the reply (raises CallError)."""

    def __call__(self, query: Any, request: Any, timeout_s: float | None = None) -> Any: ...


class Advisors:
    """Client of the foothold and stability services for each step of one run.

    Args:
        robot: the robot.
        call: function that sends a request to another service and returns the reply.
        footholds: False = every foot lands on its nominal foothold.
        stability: False = the hull of the standing feet decides.
    """

    def __init__(self, robot: Robot, call: Call, *, footholds: bool, stability: bool) -> None:
        self._names, self._call, self._footholds, self._stability = robot.leg_names, call, footholds, stability
        self._own_check = HullCheck(robot)
        self.outcomes = Outcomes()
        self.begin(0, -1)

    def begin(self, epoch: int, tick: int) -> None:
        """Begin a tick: set the epoch and the tick that its requests carry."""
        self._epoch, self._tick = epoch, tick
        self.missing = ""
        """Reason why an advisor's reply is missing in this tick, in words; empty = none is missing."""

    def select(self, step: LandingRequest) -> Sequence[FootholdReply]:
        """Return the footholds of all legs of a step by one request; without a reply nominal ones (`no_answer`)."""
        if not self._footholds:
            return nominal_footholds(step)
        quat = rotations.quat_from_rpy(0.0, 0.0, step.yaw)
        request = SelectRequest(
            epoch=self._epoch,
            tick=self._tick,
            base=BasePose(position=_floats(step.body), quat_wxyz=_floats(quat)),
            legs=tuple(
                LegRequest(leg=self._names[leg.leg], nominal=_floats(leg.nominal), stroke=_floats(leg.stroke))
                for leg in step.legs
            ),
            outcomes=self.outcomes.take(),
        )
        try:
            reply = self._call(FOOTHOLDS_SELECT, request, ANSWER_S)
        except CallError as error:
            self.missing = f"no foothold advice: {error.message}"
            return [dataclasses.replace(own, status="no_answer") for own in nominal_footholds(step)]
        for asked, leg in zip(request.legs, reply.legs, strict=True):
            self.outcomes.chose(asked, leg)
        return [FootholdReply(leg.status, leg.foothold, leg.trunk_shift, leg.reason) for leg in reply.legs]

    def check(self, step: StanceCheck) -> StanceVerdict:
        """Return the verdict on a planned step; without a reply that of the hull of the standing feet."""
        if not self._stability:
            return self._own_check(step)
        request = CheckRequest(
            contacts=tuple(
                Contact(position=_floats(p), normal=_floats(n), mu=step.mu, leg=leg)
                for p, n, leg in zip(step.positions, step.normals, step.legs, strict=True)
            ),
            joints=_floats(step.joints),
            base=CheckBase(position=_floats(step.base_position), quat_wxyz=_floats(step.base_quat)),
            movement=_floats(step.movement),
            tolerance_m=REGION_TOLERANCE_M,
        )
        try:
            reply = self._call(STABILITY_CHECK, request, ANSWER_S)
        except CallError as error:
            self.missing = f"no stability advice: {error.message}"
            return self._own_check(step)
        margins = [value for value in (reply.margin_now, reply.margin) if value is not None]
        return StanceVerdict(
            stable=reply.stable and min(margins, default=0.0) >= 0.0,
            margin=min(margins, default=None),
            status=reply.status,
            region=np.array(reply.inner) if reply.status == "ok" else None,
            com=np.array(reply.com),
            com_after=np.array(reply.com_after),
        )


def _floats(values: Iterable[float]) -> Any:
    """Return the numbers of an array or sequence as a tuple; the message's model checks its length."""
    return tuple(float(value) for value in values)
