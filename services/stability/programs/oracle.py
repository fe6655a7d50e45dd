"""Support values of one contact set, with proof, in the frame of the request.

The one place where statuses are decided: kernel first, clarabel where the kernel gives up, and a set is called
unbounded only if it can carry the weight at all.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import combined, dot

from .contacts import Array, ContactSet, StabilityError
from .fan import ASKED, Fan, explore, insert, new_fan
from .interior import FAILED, NO_DUAL, NO_PRIMAL, SOLVED, solve_lanes
from .lanes import LANES
from .reduced import SMALL_MU, matrices, reduce
from .reference import Reference

Ints = NDArray[np.int64]
SupportStatus = Literal["ok", "unbounded", "infeasible"]

STATUS: dict[int, SupportStatus] = {SOLVED: "ok", NO_DUAL: "unbounded", NO_PRIMAL: "infeasible"}
FLAT = 1e-9  # of a direction's effect on free forces; below it they do not carry the CoM


@dataclass(frozen=True, slots=True)
class Support:
    """How far the region reaches, for k directions."""

    direction: Array
    """(k, 2) unit."""
    value: Array
    """(k,) m, h(a); NaN unless status is ok."""
    point: Array
    """(k, 2) m, where it is reached."""
    status: tuple[SupportStatus, ...]
    gap: Array
    """(k,) m, value - a'point >= 0 up to rounding."""
    twist: Array
    """(k, 4) certificate (v m, w_z) of the value, about the origin of the frame; NaN unless ok."""
    force: Array
    """(k, n, 3) forces at `point`, in units of the weight; unbounded: forces that shift the CoM and hold nothing."""


class Oracle:
    """Answers h(a) for a contact set of at least one contact."""

    def __init__(self, contacts: ContactSet) -> None:
        self.contacts = contacts
        self.reduced, self.subspace = reduce(contacts)

    @cached_property
    def _reference(self) -> Reference:
        return Reference(self.reduced.a, self.reduced.c)

    @cached_property
    def sinking(self) -> Array | None:
        """Twist (v, w_z), v_z = -1, scaled frame, that proves that the set cannot carry the weight; None if it can."""
        if self.subspace is not None and self.subspace.sinking is not None:
            return self.subspace.sinking
        n = len(self.contacts)
        fan = new_fan(1, n)
        fan.direction[0] = 0.0
        self._answer(fan, 1)
        return self.twist(fan.unknown[0], np.zeros(2)) if fan.status[0] == NO_PRIMAL else None

    def drift(self, direction: Array) -> Array:
        """What free tangential forces gain per direction (k, 2): rows (k, 2j), all zero if nothing."""
        if self.subspace is None:
            return np.zeros((len(direction), 0))
        return direction @ self.subspace.drift.T

    def fan(self, direction: Array, capacity: int) -> Fan:
        """Solve for directions (k, 2), unit; the fan has room for more."""
        count = len(direction)
        fan = new_fan(max(capacity, count), len(self.contacts))
        fan.direction[:count] = direction
        self._answer(fan, count)
        return fan

    def _answer(self, fan: Fan, count: int) -> None:
        r = self.reduced
        if explore(r.a, r.h, r.c, fan, 0, count, ASKED, count, LANES)[1]:
            return
        insert(fan, 0, count)
        for k in np.flatnonzero(fan.status[:count] == FAILED):
            answer = self._reference.solve(r.h @ fan.direction[k])
            if answer.status == FAILED:
                raise StabilityError(
                    "no_convergence", "contacts", "neither solver found an answer for this contact set"
                )
            fan.status[k], fan.value[k], fan.error[k] = answer.status, answer.value, answer.error
            fan.unknown[k], fan.force[k] = answer.unknown, answer.force
            fan.point[k] = combined(r.h, answer.force).sum(axis=0)

    # -- back to the frame of the request -----------------------------------------------------------------------------

    @property
    def anchor(self) -> Array:
        """x, y of the origin of the scaled frame of regions, m."""
        r = self.reduced
        return r.origin[:2] if self.subspace is None else r.origin[:2] + r.length * self.subspace.point

    def support(self, fan: Fan, chosen: Ints) -> Support:
        """The chosen answers of a fan in metres; directions in which free forces drift are unbounded."""
        r, n = self.reduced, len(self.contacts)
        direction = fan.direction[chosen]
        drift = self.drift(direction)
        drifting = np.abs(drift).max(axis=1, initial=0.0) > FLAT
        status = np.where(drifting, NO_DUAL, fan.status[chosen])
        value, gap = np.full(len(chosen), np.nan), np.full(len(chosen), np.nan)
        point, twist = np.full((len(chosen), 2), np.nan), np.full((len(chosen), 4), np.nan)
        force = np.zeros((len(chosen), n, 3))
        for i, k in enumerate(chosen):
            if status[i] == SOLVED:
                scaled = self.twist(fan.unknown[k], direction[i])
                twist[i] = self.moved(scaled, direction[i])
                value[i] = twist[i, 2]
                point[i] = self.anchor + r.length * fan.point[k]
                gap[i] = value[i] - dot(direction[i], point[i])
                force[i] = self.forces(fan.force[k], 1.0)
            elif status[i] == NO_DUAL:
                free = drift[i] / (drift[i] @ drift[i]) if drifting[i] else None
                force[i] = self.forces(np.zeros((n, 3)) if drifting[i] else fan.force[k], 0.0, free) / r.length
        return Support(direction, value, point, tuple(STATUS[int(s)] for s in status), gap, twist, force)

    def twist(self, unknown: Array, direction: Array) -> Array:
        """Twist (v, w_z) of the scaled frame from a solution of the reduced dual."""
        return unknown if self.subspace is None else self.subspace.basis @ unknown + self.subspace.offset @ direction

    def moved(self, scaled: Array, direction: Array) -> Array:
        """Twist of the scaled frame about the origin of the request's frame, m."""
        (x, y, z), s, w = self.reduced.origin, self.reduced.length, scaled[3]
        ax, ay = direction  # v' = v - Om x origin, Om = (-a_y, a_x, w)
        return np.array(
            [s * scaled[0] - ax * z + w * y, s * scaled[1] - w * x - ay * z, s * scaled[2] + ay * y + ax * x, w]
        )

    def forces(self, cone: Array, weight: float, free: Array | None = None) -> Array:
        """Forces (n, 3) in the frame of the request from cone coordinates; free tangential ones balance the rest."""
        a = self.reduced.a
        s = self.subspace
        if s is None:
            return combined(a[:, :, :3], cone)
        own = self.columns()
        force = combined(own[:, :, :3], cone)
        if s.free.size:
            rest = np.array([0.0, 0.0, weight, 0.0]) - np.einsum("iqj,iq->j", own, cone)
            amount = np.linalg.pinv(s.free, rcond=1e-10) @ rest
            if free is not None:
                amount = amount + free
            unlimited = np.flatnonzero(np.isinf(self.contacts.mu))
            directions = s.free[:3].T.reshape(-1, 2, 3)
            force[unlimited] += np.einsum("iqd,iq->id", directions, amount.reshape(-1, 2))
        return force

    def columns(self) -> Array:
        """Columns of the balance before the subspace was taken, (n, 3, 4)."""
        mu = np.where(self.contacts.mu < SMALL_MU, 0.0, self.contacts.mu)
        return matrices(self.contacts.position, self.contacts.normal, mu)[0]


def solve_one(a: Array, rhs: Array, c: Array) -> tuple[int, float, Array, Array, float]:
    """One program of m unknowns: status, c'lam, lam (m,), x (n, 3), error; clarabel when the kernel gives up."""
    n, m = a.shape[0], a.shape[2]
    lam, x = np.empty((m, 1)), np.empty((n, 3, 1))
    error, status = np.empty(1), np.empty(1, dtype=np.int64)
    solve_lanes(a, np.ascontiguousarray(rhs[:, :, None]), c, lam, x, error, status, 0.0)
    if status[0] == FAILED:
        answer = Reference(a, c).solve(rhs)
        if answer.status == FAILED:
            raise StabilityError("no_convergence", "contacts", "neither solver found an answer for this contact set")
        return answer.status, answer.value, answer.unknown, answer.force, answer.error
    return int(status[0]), dot(c, lam[:, 0]), lam[:, 0].copy(), x[:, :, 0].copy(), float(error[0])
