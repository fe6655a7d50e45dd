"""The sensor tables of a `robot.toml`, and the named profiles of inertial units they refer to."""

import math
from pathlib import Path

from surefoot.geometry.constants import GRAVITY
from surefoot.robot import description as r
from surefoot.robot.description import RobotError
from surefoot.tables import Table, read_toml

SENSORS = Path(__file__).parents[1] / "robots" / "sensors"
MILLI_G = 1e-3 * GRAVITY


def read_imu(t: Table) -> tuple[r.ImuMount, dict[str, object]]:
    """The inertial unit, and the content of its profile's file, which counts in the description's hash."""
    name = t.text("profile")
    if name not in imu_profile_names():
        known = ", ".join(imu_profile_names())
        raise t.refuse("unknown_name", "profile", f"got {name!r}, known are {known}")
    profile, data = _imu_profile(name)
    imu = r.ImuMount(t.vector("position", 3), t.unit("quat_wxyz", 4), profile)
    t.close()
    return imu, data


def read_contacts(t: Table) -> r.ContactSensor:
    """The foot sensors: switches, or a force range."""
    kind, switches = t.text("kind", ("switch", "force")), t.integer("switches", at_least=1, at_most=4)
    on = t.number("on_n", above=0)
    off = t.number("off_n", at_least=0, at_most=on)
    low, high = 0.0, math.inf
    if kind == "force":
        low = t.number("min_n", at_least=0)
        high = t.number("max_n", above=low)
    t.close()
    return r.ContactSensor(kind, switches, on, off, low, high)


def read_encoder(t: Table) -> r.Encoder:
    """The joint position sensors."""
    resolution, zero = t.number("resolution_deg", at_least=0), t.number("zero_sigma_deg", at_least=0)
    t.close()
    return r.Encoder(math.radians(resolution), math.radians(zero))


def read_current(t: Table) -> r.CurrentSensor:
    """The current sensors of the servos."""
    gain, noise = t.number("torque_per_ampere", above=0), t.number("noise_ampere", at_least=0)
    t.close()
    return r.CurrentSensor(gain, noise)


def imu_profile_names() -> tuple[str, ...]:
    """Names of the sensor profiles that come with the package."""
    return tuple(sorted(path.stem for path in SENSORS.glob("*.toml")))


def profile_table(kind: str, name: str) -> Table:
    """The open table of `robots/<kind>s/<name>.toml`, a profile of sensors that several robots may have.

    Raises:
        RobotError: unknown name, or a file of another kind.
    """
    folder = SENSORS.parent / f"{kind}s"
    known = tuple(sorted(path.stem for path in folder.glob("*.toml")))
    if name not in known:
        raise RobotError("unknown_name", kind, f"got {name!r}, known are {', '.join(known)}")
    table = Table(read_toml(folder / f"{name}.toml", RobotError), f"{kind}s.{name}", RobotError)
    table.text("schema", (f"surefoot.{kind}/1",))
    table.text("name", (name,))
    table.text("source")
    return table


def read_imu_profile(name: str) -> r.ImuProfile:
    """Read a sensor profile by name.

    Raises:
        RobotError: unknown name, or a number that cannot be.
    """
    if name not in imu_profile_names():
        raise RobotError("unknown_name", "profile", f"got {name!r}, known are {', '.join(imu_profile_names())}")
    return _imu_profile(name)[0]


def _imu_profile(name: str) -> tuple[r.ImuProfile, dict[str, object]]:
    data = read_toml(SENSORS / f"{name}.toml", RobotError)
    p = Table(data, f"sensors.{name}", RobotError)
    p.text("schema", ("surefoot.imu/1",))
    p.text("name", (name,))
    p.text("source")
    g, a, deg = p.table("gyro"), p.table("accel"), math.radians(1.0)
    gyro = _noise(g, (("deg_s", deg),) * 3 + (("deg_s_rthz", deg),))
    accel = _noise(a, (("mg", MILLI_G), ("g", GRAVITY), ("mg", MILLI_G), ("mg_rthz", MILLI_G)))
    p.close()
    return r.ImuProfile(name, gyro, accel), data


def _noise(t: Table, units: tuple[tuple[str, float], ...]) -> r.AxisNoise:
    (lsb, k_lsb), (limit, k_limit), (bias, k_bias), (density, k_density) = units
    noise = r.AxisNoise(
        lsb=k_lsb * t.number(f"lsb_{lsb}", at_least=0),
        limit=k_limit * t.number(f"range_{limit}", above=0),
        noise_density=k_density * t.number(f"noise_{density}", at_least=0),
        bias_turn_on=k_bias * t.number(f"bias_turn_on_{bias}", at_least=0),
        bias_in_run=k_bias * t.number(f"bias_in_run_{bias}", at_least=0),
        bias_time_s=t.number("bias_time_s", above=0),
    )
    t.close()
    return noise
