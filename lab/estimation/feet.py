"""Feet and contacts of logs without a robot description, from statements on the feet and from assumptions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.errors import SurefootError
from surefoot.record.columns import Columns
from surefoot.tables import did_you_mean

from .contacts import by_force, by_height, mean_up

KINDS = ("point", "sole", "line")
ON, OFF = 0.25, 0.15
"""`ON`: force above which a foot stands, share of the median total foot force; `OFF`: force below which it lifts, share
of the same total (hysteresis)."""
SAVED = 0.1
"""Share of foot samples in which a foot stands though none exceeds the force threshold; with a larger share `surefoot
estimate` prints a note."""
SOLE_SHARES = (1 / 3, 1 / 5)
"""Length and width of a sole of unknown size, each as a share of the distance from IMU to foot."""
LEVEL_DEG = 15.0
"""Spread of the direction of gravity in the axes of a standing foot, deg rms, above which the body is a shank, not a
sole."""


@dataclass(frozen=True)
class FeetOptions:
    """Shape, size and contact thresholds of a log's feet as stated by the user or the file; None = not stated."""

    kind: str | None = None  # of `KINDS`
    radius: Array | None = None  # (1,) or (F,) m, of round feet
    sole: Array | None = None  # (2,) length and width, m; (1,) length of a line
    contact_on: float | None = None  # N, force from which a foot stands
    contact_off: float | None = None  # N, force below which it does not stand any more

    @classmethod
    def of(cls, stated: Mapping[str, Any]) -> "FeetOptions":
        """Return checked options from the metadata `feet`, `foot_radius`, `sole_size`, `contact_on`, `contact_off`.

        Raises:
            SurefootError: one of them has no allowed value.
        """
        numbers = {key: _numbers(key, stated[key]) for key in stated if key != "feet" and stated[key] is not None}
        kind = stated.get("feet")
        kind = None if kind is None or np.ndim(kind) else str(kind)  # some logs call the names of their feet so
        if kind is not None and kind not in KINDS:
            raise SurefootError(
                "invalid", f"got {kind!r}{did_you_mean(kind, KINDS)}; known are {', '.join(KINDS)}", "feet"
            )
        size = numbers.get("sole_size")
        if size is not None and len(size) > 2:
            raise SurefootError("invalid", f"got {len(size)} sizes; wanted are length and width", "sole_size")
        on, off = (float(numbers[key][0]) if key in numbers else None for key in ("contact_on", "contact_off"))
        if on is not None and off is not None and off > on:
            raise SurefootError("invalid", f"got {off:g} N; it is at most contact_on, {on:g} N", "contact_off")
        return cls(kind, numbers.get("foot_radius"), size, on, off)

    def over(self, other: "FeetOptions") -> "FeetOptions":
        """Return these options, with those that are None taken from `other`."""
        mine = {f.name: getattr(self, f.name) for f in fields(self)}
        return replace(other, **{key: value for key, value in mine.items() if value is not None})

    @property
    def shaped(self) -> bool:
        """True if kind, radius or sole of the feet is stated, False if none is."""
        return not (self.kind is None and self.radius is None and self.sole is None)


UNSTATED = FeetOptions()


def _numbers(key: str, value: Any) -> Array:
    """Return the numbers of a metadata `key`, (k,), each 0 or more; lengths in m must be below 1.

    Raises:
        SurefootError: the value is no such number.
    """
    try:
        out = np.atleast_1d(np.asarray(value, dtype=np.float64)).ravel()
    except (TypeError, ValueError):
        out = np.empty(0)
    most = np.inf if key.startswith("contact") else 1.0
    if not out.size or not np.all((out >= 0.0) & (out < most)):
        allowed = "N, 0 or more" if most > 1.0 else "m, 0 to 1"
        raise SurefootError("invalid", f"got {np.asarray(value).tolist()!r}; wanted is a number in {allowed}", key)
    return out


def up_at(columns: Columns) -> Array:
    """Return the direction of the mean specific force around each foot sample, (m, 3) unit vectors, axes of the IMU.

    `columns`: of a log, with stamps, ns, and accelerometer, m/s^2.
    """
    return mean_up(columns["stamp_ns"], np.asarray(columns["acc"], dtype=np.float64), columns["foot_stamp_ns"])


def contacts(columns: Columns, position: Array, given: FeetOptions, notes: list[str]) -> tuple[Flags, Flags | None]:
    """Return contacts (m, F) and switches (m, F, S) or None, from the columns that show them.

    Args:
        columns: arrays of a log, with flags or forces of the feet.
        position: positions of the feet, (m, F, 3) m, IMU axes; shows contacts where nothing else does.
        given: statements on the feet; with `contact_on`, forces count more than flags.
        notes: gets what was assumed.

    Raises:
        SurefootError: flags are not within 0 to 1.
    """
    forces_first = "force" in columns and given.contact_on is not None
    if "touch" in columns and not forces_first:
        touch = columns["touch"] > 0.5
        return np.asarray(touch.any(axis=2), dtype=np.bool_), touch
    if "contact" in columns and not forces_first:
        contact = np.asarray(columns["contact"], dtype=np.float64)
        outside = np.argwhere((contact < 0.0) | (contact > 1.0))
        if outside.size:
            row, foot = (int(i) for i in outside[0])
            value = contact[row, foot]
            raise SurefootError(
                "invalid", f"row {row}: contact{foot} is {value:.3g}, wanted is 0 to 1", f"contact{foot}"
            )
        return contact > 0.5, None
    if "force" in columns:
        return _by_force(np.nan_to_num(np.asarray(columns["force"], dtype=np.float64)), given, notes), None
    notes.append("no contacts: feet within 5 mm of the lowest one are taken to stand")
    return by_height(position, up_at(columns)), None


def _by_force(force: Array, given: FeetOptions, notes: list[str]) -> Flags:
    """Return contacts (m, F) from forces (m, F) N by two thresholds, stated or a share of the usual total force."""
    on = ON * float(np.median(force.sum(axis=1))) if given.contact_on is None else given.contact_on
    off = OFF / ON * on if given.contact_off is None else given.contact_off
    notes.append(f"contacts by force: from {on:.0f} N on, until below {off:.0f} N")
    contact, saved = by_force(force, on, off)
    if saved > SAVED:
        notes.append(
            f"in {100.0 * saved:.0f} % of the rows only the most loaded foot stands, with less: thresholds too high?"
        )
    return contact


def shape(
    given: FeetOptions, columns: Columns, position: Array, rot: Array, contact: Flags, notes: list[str]
) -> dict[str, Array]:
    """Return `points` (F, K, 3) m of soles and lines, foot axes, or `radius` (F,) m of points, as fields of a log.

    Args:
        given: statements on the feet.
        columns: arrays of the log.
        position: positions of the feet, (m, F, 3) m, IMU axes.
        rot: rotation from foot to IMU, (m, F, 3, 3).
        contact: feet that stand, (m, F).
        notes: gets what was assumed.

    Raises:
        SurefootError: the orientations that a sole needs are missing, or show that the foot has no flat sole.
    """
    feet = position.shape[1]
    turned = "foot_rotation" in columns or "foot_quat_wxyz" in columns or "joints" in columns
    kind = given.kind
    if kind is None and given.sole is not None:
        kind = "sole" if len(given.sole) == 2 else "line"
    up = _up_in_foot(columns, rot, contact) if turned else []
    if kind is None and given.radius is None and feet == 2 and turned and _soles(rot, up):
        kind = "sole"
        notes.append("two feet with an orientation each: taken as soles (--feet point, if they are none)")
    if kind is None or kind == "point":
        radius = np.zeros(1) if given.radius is None else given.radius
        if len(radius) not in (1, feet):
            raise SurefootError("invalid", f"got {len(radius)} radii; there are {feet} feet", "foot_radius")
        return {"radius": np.broadcast_to(radius, feet).copy()}
    if not turned:
        raise SurefootError("invalid", f"--feet {kind} needs the orientation of the feet (foot_rotation)", "feet")
    size = given.sole
    if size is None:
        seen = np.linalg.norm(position, axis=2)
        seen = seen[np.isfinite(seen)]
        reach = float(np.median(seen)) if seen.size else 1.0
        size = reach * np.array(SOLE_SHARES)
        notes.append(f"size of the soles: {size[0]:.3f} x {size[1]:.3f} m assumed (--sole LENGTH,WIDTH)")
    return {"points": np.array([_corners(kind, foot, each, size) for foot, each in enumerate(up)])}


def _up_in_foot(columns: Columns, rot: Array, contact: Flags) -> Sequence[Array]:
    """Return the direction of gravity in each standing foot, F arrays (k, 3), foot axes.

    `rot`: rotation from foot to IMU, (m, F, 3, 3); `contact`: feet that stand, (m, F).
    """
    seen = np.einsum("mfji,mj->mfi", rot, up_at(columns))
    stands = contact & np.isfinite(seen).all(axis=2)
    return [seen[stands[:, f], f] for f in range(contact.shape[1])]


def _soles(rot: Array, up: Sequence[Array]) -> bool:
    """Return True if feet have orientations of their own, `rot` (m, F, 3, 3), and stay level where they stand.

    `up`: direction of gravity in each standing foot, F arrays (k, 3), foot axes.
    """
    apart = rot[:, 0] - rot[:, 1]
    if np.nanmax(np.abs(apart), initial=0.0) < 1e-6 or any(len(each) == 0 for each in up):
        return False
    spread = [np.sqrt(np.mean(np.sum((each - each.mean(axis=0)) ** 2, axis=1))) for each in up]
    return bool(max(spread) < np.radians(LEVEL_DEG))


def _corners(kind: str, foot: int, up: Array, size: Array) -> Array:
    """Return the ends of a line, (2, 3), or the corners of a sole, (4, 3), m, foot axes.

    The length lies along x, or along z of a foot whose x axis points up or down. `kind`: line or sole; `foot`: its
    index; `up`: direction of gravity where it stands, (k, 3), foot axes; `size`: length and width, m.
    """
    mean = up.mean(axis=0) if len(up) else np.array([0.0, 0.0, 1.0])
    vertical = int(np.argmax(np.abs(mean)))
    off = float(np.degrees(np.arccos(min(1.0, abs(mean[vertical]) / max(float(np.linalg.norm(mean)), 1e-9)))))
    if off > 30.0:
        text = f"no axis of foot {foot} is vertical where it stands, the nearest is {off:.0f} deg off"
        raise SurefootError("invalid", f"{text}; are the rotations those from foot to IMU axes?", "foot_rotation")
    ahead = 0 if vertical != 0 else 2
    half = 0.5 * size[0] * np.eye(3)[ahead]
    if kind == "line":
        return np.array([half, -half])
    width = size[1] if len(size) > 1 else size[0] * SOLE_SHARES[1] / SOLE_SHARES[0]
    side = 0.5 * width * np.eye(3)[3 - ahead - vertical]
    return np.array([half + side, half - side, side - half, -half - side])
