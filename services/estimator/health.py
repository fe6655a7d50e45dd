"""Health of an estimate, in flags and in words."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

from .inputs.check import Faults

SILENT_S = 0.2  # feet older than this: a sensor is absent
NO_CONTACT_S = 0.5  # last contact of any foot older than this: contacts are absent
UNCORRECTED_S = 1.0  # prediction only for longer: the velocity is worth little
MAX_NIS = 16.0  # 3 expected, 13 at most on clean logs of others: the feet contradict the inertial unit or each other
STANDING = ("standing",)  # reasons of a robot that stands and is well
LEG_WORDS = (
    "left out: foot {}, which contradicts the other sensors",
    "switch of foot {} contradicts its motion: stuck, or swapped; its height decides",
    "encoders of foot {} jump",
    "left out: foot {}, whose encoders stand still",
    "encoders of foot {} are swapped, and taken the other way round",
)
"""Texts of the parts of `LegSensors` that name feet, in their order; `{}` stands for the feet."""
ROUGH_EXCESS = 3.0  # inertial noise over the sensor's from which it is reported


class LegSensors(NamedTuple):
    """Feet whose sensors are wrong, bit f for foot f, and the delay of all stamps of the feet.

    left_out: its sensors contradict what is known of the motion; switches: its switch contradicts its motion; jumping:
    its encoders have jumped; still: they stand still; swapped: they are those of another foot; late_ns: delay of the
    stamps, ns, below 0 = early.
    """

    left_out: int  # it contradicts what is known of the motion: any of its sensors
    switches: int  # its switch contradicts its motion
    jumping: int  # its encoders have jumped
    still: int  # its encoders stand still
    swapped: int  # its encoders are those of another foot
    late_ns: int  # time by which the stamps of all feet are late, ns; below 0: early


NO_LEGS = LegSensors(0, 0, 0, 0, 0, 0)
"""Value of `LegSensors` while no sensor of a leg is wrong and no stamp is late."""


class Condition(NamedTuple):
    """Numbers from which flags and reasons of an estimate follow; no texts, so that kernels can compute them.

    Times since feet came, since one touched and since feet corrected the velocity are in s; `nis` is the mean
    normalised innovation squared, `excess` the factor of the inertial noise over the sensor's, `external_out` the
    number of samples of another source in a row that were left out.
    """

    initialised: bool
    standing: bool
    healthy: bool  # finite, positive variances, g near 9.81, a speed a robot can have
    nis: float  # mean normalised innovation squared, 3 degrees of freedom
    slipping: bool  # a foot slides
    excess: float  # factor of the inertial noise over the sensor's
    faults: Faults
    since_feet_s: float
    since_contact_s: float
    since_velocity_s: float  # since the feet last corrected the velocity
    legs: LegSensors
    blind: bool  # all feet are left out
    unsettled: bool = False  # the velocity was lost and feet are left out since: they may be right, and the tilt wrong
    external_out: int = 0  # samples from elsewhere in a row that were left out
    sinks: float = 0.0  # speed at which feet sink while they stand, m/s; below 0: they rise


def flags(c: Condition) -> tuple[bool, bool, bool]:
    """Return the flags of an estimate whose inputs are not silent.

    Returns:
        inputs_ok: all inputs of the last 100 ms were accepted, without a gap, and the joints are not older than 0.2 s;
        filter_ok: the estimate is consistent and corrected by the feet; sensors_ok: no sensor is saturated, frozen,
        absent or contradicts the others, and the robot does not fall.
    """
    faults, legs = c.faults, c.legs
    legs_wrong = legs.left_out | legs.switches | legs.jumping | legs.still | legs.swapped | legs.late_ns
    joints_frozen = faults.feet_repeat and c.initialised and not c.standing
    broken = faults.imu_frozen or joints_frozen or faults.saturated or faults.weightless or legs_wrong != 0
    inputs_ok = not faults.refused and c.since_feet_s < SILENT_S
    corrected = c.since_velocity_s < UNCORRECTED_S and not c.blind and not c.unsettled
    filter_ok = c.initialised and c.healthy and c.nis < MAX_NIS and corrected
    sensors_ok = not broken and c.since_feet_s < SILENT_S and c.since_contact_s < NO_CONTACT_S
    return inputs_ok, filter_ok, sensors_ok


flags_of = kernel(flags)
"""Compiled `flags`, for kernels; Python calls `flags`, because passing a condition takes longer than evaluating it."""


@kernel
def is_quiet(c: Condition) -> bool:
    """Return True if all flags are true, feet neither slip nor sink, noise is low and no external sample was left out.

    Silent inputs and wrong units of sensors are not considered.
    """
    inputs_ok, filter_ok, sensors_ok = flags_of(c)
    even = not c.slipping and c.excess < ROUGH_EXCESS and c.sinks == 0.0
    return inputs_ok and filter_ok and sensors_ok and even and not c.external_out


def reasons(
    c: Condition, silent: Mapping[str, float], unit: str, last_bad: str, slipping: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Return the reasons of an estimate's flags in words, the gravest first; empty: no fault, and the robot walks.

    Args:
        c: numbers from which the flags follow.
        silent: inputs that are silent, by name, and for how long, s.
        unit: text about the wrong unit of a sensor; empty: none is wrong.
        last_bad: last refusal or gap, e.g. `imu_nonfinite`.
        slipping: which feet slide, (L,).
    """
    out: list[str] = []
    if not c.initialised:
        out.append("waiting for a start: a rest of half a second, or a second of motion with contacts")
    if unit:
        out.append(f"refused: {unit}")
    out.extend(f"{name} is silent for {age:.1f} s" for name, age in silent.items())
    if c.faults.imu_frozen:
        out.append("the inertial unit repeats one sample")
    if c.faults.feet_repeat and c.initialised and not c.standing:
        out.append("the joint angles repeat one sample while the robot moves")
    if c.faults.saturated:
        out.append("the inertial unit is at the end of its range")
    if c.faults.weightless:
        out.append("the accelerometer shows no weight: a fall, or another unit")
    if c.since_feet_s >= SILENT_S:
        out.append(f"no joint angles for {c.since_feet_s:.1f} s")
    elif c.since_contact_s >= NO_CONTACT_S:
        out.append(f"no foot in contact for {c.since_contact_s:.1f} s")
    if c.initialised and c.since_velocity_s >= UNCORRECTED_S:
        out.append(f"no correction by the feet for {c.since_velocity_s:.1f} s")
    if c.unsettled:
        out.append("the velocity was lost, and feet contradict it since: the tilt may be wrong")
    if c.faults.refused:
        out.append(f"degraded input: {last_bad}")
    if c.initialised and not c.healthy:
        out.append("the estimate is out of all bounds")
    if math.isfinite(c.nis) and c.nis >= MAX_NIS:
        out.append(f"inconsistent: normalised innovation {c.nis:.0f}, 3 expected")
    for bits, words in zip(c.legs, LEG_WORDS, strict=False):
        if bits:
            out.append(words.format(", ".join(str(f) for f in range(len(slipping)) if (bits >> f) & 1)))
    if c.legs.late_ns:
        side = "late" if c.legs.late_ns > 0 else "early"
        out.append(f"the stamps of the feet are {abs(1e-6 * c.legs.late_ns):.0f} ms {side}, which is taken off")
    if c.external_out:
        out.append(f"left out: {c.external_out} samples from elsewhere, which contradict the estimate")
    if c.slipping:
        out.append("slipping: foot " + ", ".join(str(i) for i in np.flatnonzero(slipping)))
    if c.sinks != 0.0:
        way = "sink" if c.sinks > 0.0 else "rise"
        out.append(
            f"feet {way} by {abs(100.0 * c.sinks):.1f} cm/s while they stand: soft ground, or legs of other lengths"
        )
    if c.excess >= ROUGH_EXCESS:
        out.append(f"the noise of the inertial unit counts {c.excess:.0f} times that of its sensor")
    return (*out, *STANDING) if c.standing else tuple(out)
