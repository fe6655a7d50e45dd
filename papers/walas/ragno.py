"""Reproduction of Walas & Belter (2011), sections 4.1 to 4.3, with Ragno: displacement of the CoM, and a slope."""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.polygon import area, hull
from surefoot.lab.report.findings import Finding, at_most, fact, near
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions, forward, legs_ik
from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.regions.margin import Margin, margin
from surefoot.services.stability.regions.model import Region
from surefoot.services.stability.regions.movement import Check, check
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.sensing.forces import com_from_forces
from surefoot.services.stability.sensing.posture import PosedRobot, Shift

CM = 100.0  # cm per m
TURN_DEG = 30.0
SLOPE_DEG, SLOPE_X, TRUNK_Z = 30.0, -0.05, 0.12
MOVE = np.array([0.043, 0.0, 0.0])
DEMO_MU = 0.45
SLOPE_TABLE = {0.25: (0.473, 0.5), 0.35: (0.658, 6.5), 0.45: (0.826, 11.6), 0.55: (0.967, 15.8), 0.578: (1.0, 16.75)}
"""Results of this project's feasibility study by friction coefficient: region area over hull area (no unit), largest x
of the region (cm)."""


@dataclass(frozen=True)
class Posture:
    """Places of CoM, hips and feet of Ragno with all legs turned by one angle (Fig. 15 of Walas & Belter)."""

    turn_deg: float
    com: Array  # (3,) m, base_link
    hips: Array  # (6, 2) m
    leg_com: Array  # (6, 2) m, CoM of each leg
    feet: Array  # (6, 2) m


@dataclass(frozen=True)
class Slope:
    """Stability of the robot on the 30 degree slope with one friction coefficient (Fig. 17 of Walas & Belter).

    `sixteen` is the region by 16 directions, `region` by as many as its shape needs, `hull` that of the feet, (k, 2) m;
    `plain` and `corrected` are checks without and with the shift of the CoM by the legs, r_KIN.
    """

    mu: float
    contacts: ContactSet
    com: Array  # (2,) m, now
    shift: Array  # (3,) m, r_KIN
    sixteen: Region
    region: Region
    hull: Array
    plain: Check
    """Check of the movement without the shift of the CoM by the moving legs (r_KIN)."""
    corrected: Check
    printed: float
    """Stability by equation (28) of Walas & Belter as printed, m: the norm of the distance from the support point,
    never < 0."""

    @property
    def share(self) -> float:
        """Area of the stability region over the area of the hull of the contacts, no unit."""
        return float(area(self.region.inner) / area(self.hull))


def postures(robot: Robot) -> tuple[Posture, ...]:
    """Return Ragno with its legs in the neutral position, 30 degrees forward, and 30 degrees backward."""
    found: list[Posture] = []
    for turn in (0.0, TURN_DEG, -TURN_DEG):
        q = robot.neutral.copy()
        for leg in robot.legs:
            q[leg.joints[0]] += np.radians(turn) * (-1.0 if leg.hip[1] > 0.0 else 1.0)
        rot, pos = forward(robot.model, q)
        legs = np.array(
            [
                np.average(
                    [pos[k] + rot[k] @ robot.links[k].com for k in leg.links],
                    axis=0,
                    weights=[robot.links[k].mass for k in leg.links],
                )
                for leg in robot.legs
            ]
        )
        hips = np.array([leg.hip[:2] for leg in robot.legs])
        feet = foot_positions(robot.model, q)[:, :2]
        found.append(Posture(turn, com(robot.model, q), hips, legs[:, :2], feet))
    return tuple(found)


def slope_contacts(robot: Robot, mu: float) -> ContactSet:
    """Return the contacts of fore and middle feet on a slope that begins at x = -5 cm, hind feet on level ground.

    `mu`: friction coefficient.
    """
    tilt = np.radians(SLOPE_DEG)
    feet = foot_positions(robot.model, robot.neutral)
    feet[:, 2] = np.maximum(0.0, (feet[:, 0] - SLOPE_X) * np.tan(tilt))
    uphill, up = (-np.sin(tilt), 0.0, np.cos(tilt)), (0.0, 0.0, 1.0)
    return contact_set(feet, [uphill if z > 0.0 else up for z in feet[:, 2]], mu)


def slope(robot: Robot, mu: float) -> Slope:
    """Return the stability of Ragno on the 30 degree slope, m, for its trunk movement of 4.3 cm, by norm and by margin.

    `mu`: friction coefficient.
    """
    contacts = slope_contacts(robot, mu)
    q = legs_ik(robot.model, contacts.position - [0.0, 0.0, TRUNK_Z])[0]
    now = com(robot.model, q)[:2]
    shift: Shift = PosedRobot(robot, q, np.zeros(3), np.eye(3)).moved(MOVE, np.ones(robot.nlegs, dtype=np.bool_))
    whole, sixteen = region(contacts, tolerance=1e-6, limit=720), region(contacts, equally_spaced(16))
    edge = sixteen.support.point[0] - now  # r_SOCP as the paper takes it: the support point towards +x
    return Slope(
        mu=mu,
        contacts=contacts,
        com=now,
        shift=shift.vector,
        sixteen=sixteen,
        region=whole,
        hull=hull(np.ascontiguousarray(contacts.position[:, :2])),
        plain=check(whole, now, MOVE, np.zeros(3)),
        corrected=check(whole, now, MOVE, shift.vector),
        printed=float(np.linalg.norm(edge - MOVE[:2] - shift.vector[:2])),
    )


def gsm(found: Check) -> float:
    """Return the signed geometric stability margin of a check, cm; NaN if there is none."""
    return float("nan") if found.gsm is None or found.gsm.value is None else CM * found.gsm.value


def figure_15(robot: Robot, found: tuple[Posture, ...]) -> list[Finding]:
    """Return the findings on Fig. 15 of Walas & Belter, section 4.2: how far turned legs displace the CoM.

    `found`: the neutral posture, all legs turned forward, and backward.
    """
    neutral, forward_, backward = (posture.com[0] for posture in found)
    legs = sum(robot.links[k].mass for leg in robot.legs for k in leg.links) / robot.mass
    box = CM * np.ptp(found[0].feet, axis=0)
    ahead, behind = CM * (forward_ - neutral), CM * (backward - neutral)
    return [
        near("2.2", "length over the feet, cm", 33.0, float(box[0]), 0.6, 1),
        near("2.2", "width over the feet, cm", 30.0, float(box[1]), 0.6, 1),
        near("2.2", "mass, kg", 2.155, robot.mass, 5e-4, 3),
        near("4.2", "share of the legs in the mass", 0.5, float(legs), 5e-3, 3),
        near("4.2, Fig. 15", "CoM shift, legs 30 deg forward, cm", 1.1, float(ahead), 0.05),
        near("4.2, Fig. 15", "CoM shift, legs 30 deg backward, cm", -0.9, float(behind), 0.05),
        near("4.2, Fig. 15", "whole shift, cm", 2.0, float(ahead - behind), 0.05),
        near("4.2", "shift over the trunk's length of 20 cm, %", 10.0, float((ahead - behind) / 0.2), 0.5, 1),
    ]


def figure_17(found: tuple[Slope, ...]) -> list[Finding]:
    """Return the findings on Fig. 17 of Walas & Belter, section 4.3: a robot on a slope with each friction coefficient.

    Walas & Belter do not print the coefficients; those used here are this project's.
    """
    rows: list[Finding] = []
    for s in found:
        share, reach = SLOPE_TABLE[s.mu]
        where = f"4.3, Fig. 17, mu {s.mu:g}"
        rows.append(near(f"{where} (note)", "area of the region over the hull's", share, s.share, 1e-3, 3))
        largest = CM * float(s.sixteen.support.value[0])
        rows.append(near(f"{where} (note)", "largest x of the region, cm", reach, largest, 0.06))
        without, with_ = gsm(s.plain), gsm(s.corrected)
        rows.append(
            fact(where, "signed GSM without / with kinematic correction, cm", "", f"{without:.2f} / {with_:.2f}")
        )
    demo = next(s for s in found if s.mu == DEMO_MU)
    smaller = demo.share < 1.0
    sliding = found[0]
    rows += [
        fact("4.3, Fig. 17", "region smaller than the hull", "yes", "yes" if smaller else "no", smaller),
        fact(
            "4.3, Fig. 17",
            "kinematic correction r_KIN for r_M = +4.3 cm, cm",
            "backward",
            f"{CM * demo.shift[0]:.2f}",
            bool(demo.shift[0] < 0.0),
            "< 0",
        ),
        near("4.3", "GSM with minus without correction = -r_KIN, cm", -CM * float(demo.shift[0]),
             gsm(demo.corrected) - gsm(demo.plain), 1e-6),
        fact(
            "(28)",
            f"GSM at mu {sliding.mu:g}, as printed (a norm) / signed, cm",
            "",
            f"{CM * sliding.printed:.2f} / {gsm(sliding.corrected):.2f}",
            gsm(sliding.corrected) < 0.0 < sliding.printed,
            "the norm hides that the CoM is outside",
        ),
    ]  # fmt: skip
    left_out = 1.0 - area(demo.sixteen.inner) / area(demo.region.inner)
    adaptive = 1.0 - area(region(demo.contacts, tolerance=1e-9, limit=16).inner) / area(demo.region.inner)
    rows.append(
        fact(
            "4.1",
            f"area left out by 16 fixed / 16 adaptive directions, mu {DEMO_MU:g}, %",
            "",
            f"{100.0 * left_out:.2f} / {100.0 * adaptive:.2f}",
            adaptive <= 5e-3,
            "adaptive <= 0.5",
        )
    )
    return rows


def consistency(found: tuple[Slope, ...], weight: float) -> Finding:
    """Return the finding on section 4.7 of Walas & Belter: the CoM by the forces of each optimum is that optimum.

    `weight`: of the robot, N.
    """
    worst = 0.0
    for s in found:
        support = s.sixteen.support
        for k in range(len(support.direction)):
            spread = np.tile(np.eye(3), (len(s.contacts), 1, 1))
            back = com_from_forces(s.contacts.position, weight * support.force[k], spread)
            error = float("inf") if back is None else float(np.abs(back.com - support.point[k]).max())
            worst = max(worst, error)
    return at_most("4.7", "CoM from the forces of the optimum, largest error, m", worst, 1e-8, '"exactly the same"')


def extended_check(s: Slope, measured: Array) -> tuple[Margin, Check]:
    """Return the margin on a slope and whether the planned movement keeps it, from a measured CoM (3,) m.

    Walas & Belter, section 4.6, Fig. 21.
    """
    return margin(s.region, measured), check(s.region, measured, MOVE, s.shift)
