"""Health of an estimate, in flags and in words."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

SILENT_S = 0.2  # feet older than this: a sensor is absent
NO_CONTACT_S = 0.5  # the same for the last contact of any foot
UNCORRECTED_S = 1.0  # prediction only for longer: the velocity is worth little
MAX_NIS = 50.0  # three degrees of freedom; a filter so surprised is not to be trusted
ROUGH_EXCESS = 3.0  # inertial noise over the sensor's from which it is worth a word


class Condition(NamedTuple):
    """What flags and words are made of."""

    initialised: bool
    standing: bool
    healthy: bool  # finite, positive variances, g near 9.81, a speed a robot can have
    nis: float  # mean normalised innovation squared, 3 degrees of freedom
    slipping: NDArray[np.bool_]  # (L,)
    silent: Mapping[str, float]  # inputs that are silent, by name, and for how long, s
    unit: str  # what is wrong with the unit of a sensor; empty: nothing
    refused_lately: str | None  # last refusal or gap of the last 100 ms, e.g. imu_nonfinite
    saturated: bool
    weightless: bool
    imu_frozen: bool
    joints_frozen: bool
    since_feet_s: float
    since_contact_s: float
    since_velocity_s: float  # since the feet last corrected the velocity
    excess: float  # factor of the inertial noise over the sensor's

    @property
    def flags(self) -> tuple[bool, bool, bool]:
        """`inputs_ok`, `filter_ok` and `sensors_ok`, see `flags_of`."""
        frozen = self.imu_frozen or self.joints_frozen or self.saturated or self.weightless
        return flags_of(
            self.initialised, self.healthy, self.nis, self.refused_lately is not None, frozen, bool(self.silent),
            self.since_feet_s, self.since_contact_s, self.since_velocity_s,
        )  # fmt: skip


@kernel
def flags_of(
    initialised: bool, healthy: bool, nis: float, refused: bool, frozen: bool, silent: bool, since_feet_s: float,
    since_contact_s: float, since_velocity_s: float,
) -> tuple[bool, bool, bool]:  # fmt: skip
    """Return the flags of an estimate.

    Args:
        initialised: the filter has started.
        healthy: see `Condition`.
        nis: mean normalised innovation squared, 3 degrees of freedom.
        refused: an input was refused in the last 100 ms.
        frozen: a sensor is frozen, saturated or shows no weight.
        silent: an input is silent.
        since_feet_s: age of the joints, s.
        since_contact_s: since a foot was in contact, s.
        since_velocity_s: since the feet last corrected the velocity, s.

    Returns:
        Whether all inputs of the last 100 ms were accepted and none is silent; whether the estimate is consistent and
        corrected; whether no sensor is saturated, frozen or absent, and the robot does not fall.
    """
    inputs_ok = not silent and not refused and since_feet_s < SILENT_S
    filter_ok = initialised and healthy and nis < MAX_NIS and since_velocity_s < UNCORRECTED_S
    sensors_ok = not frozen and not silent and since_feet_s < SILENT_S and since_contact_s < NO_CONTACT_S
    return inputs_ok, filter_ok, sensors_ok


def reasons(c: Condition) -> tuple[str, ...]:
    """What is to be said of an estimate, the gravest first; empty: it walks and all is well."""
    out: list[str] = []
    if not c.initialised:
        out.append("waiting for a start: a rest of half a second, or two seconds of motion with contacts")
    if c.unit:
        out.append(f"refused: {c.unit}")
    out.extend(f"{name} is silent for {age:.1f} s" for name, age in c.silent.items())
    if c.imu_frozen:
        out.append("the inertial unit repeats one sample")
    if c.joints_frozen:
        out.append("the joint angles repeat one sample while the robot moves")
    if c.saturated:
        out.append("the inertial unit is at the end of its range")
    if c.weightless:
        out.append("the accelerometer shows no weight: a fall, or another unit")
    if c.since_feet_s >= SILENT_S:
        out.append(f"no joint angles for {c.since_feet_s:.1f} s")
    elif c.since_contact_s >= NO_CONTACT_S:
        out.append(f"no foot in contact for {c.since_contact_s:.1f} s")
    if c.initialised and c.since_velocity_s >= UNCORRECTED_S:
        out.append(f"no correction by the feet for {c.since_velocity_s:.1f} s")
    if c.refused_lately is not None:
        out.append(f"degraded input: {c.refused_lately}")
    if c.initialised and not c.healthy:
        out.append("the estimate is out of all bounds")
    if math.isfinite(c.nis) and c.nis >= MAX_NIS:
        out.append(f"inconsistent: normalised innovation {c.nis:.0f}, 3 expected")
    if any(c.slipping.tolist()):
        out.append("slipping: foot " + ", ".join(str(i) for i in np.flatnonzero(c.slipping)))
    if c.excess >= ROUGH_EXCESS:
        out.append(f"the inertial unit errs {c.excess:.0f} times as much as its sensor")
    if c.standing:
        out.append("standing")
    return tuple(out)
