"""Faults of sensors, servos, packets, camera and ultrasound, each with a start, a duration and a seed."""

import math
from dataclasses import asdict, dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import InvalidField
from surefoot.schemas.sim import FaultKind
from surefoot.schemas.topics import TICK_S

from ..ground.grid import random_stream
from .samples import Detection

KINDS: tuple[str, ...] = get_args(FaultKind)
IMU_AXES = ("acc_x", "acc_y", "acc_z", "gyro_x", "gyro_y", "gyro_z")
CHANNELS = ("imu", "joints", "contacts", "command")
MAX_DELAY_TICKS = 100
SENSORS = ("imu", "joints", "contacts", "landmarks", "range")
"""Sensors that can fail as a whole, by the seven `sensor_*` faults, which are those of PX4's failure injection."""
IMAGE = "image"
"""Name of the camera that takes images, which only `camera_*` faults affect."""
STAMPED = SENSORS[:3]
"""Sensors whose samples carry a stamp, so that they can be delayed by `sensor_delayed`."""
GARBAGE = {"imu": np.repeat((160.0, 35.0), 3), "joints": math.pi, "contacts": 100.0, "landmarks": math.pi, "range": 5.0}
"""Largest magnitude of the random values that each sensor reports under the garbage fault: IMU m/s^2, rad/s; joints
rad, A, Nm; contacts N; landmarks m or rad; range m."""


class FaultError(InvalidField):
    """Refusal of an impossible fault; `field` names the wrong argument."""


@dataclass(frozen=True)
class Fault:
    """Fault of a sensor, servo, camera or packet line, active in control ticks start_tick <= tick < end_tick."""

    kind: str
    start_tick: int
    duration: float
    """Duration of the fault, s of simulated time."""
    target: str = ""
    """Name of the joint, leg, IMU axis (or `acc`, `gyro`), channel or sensor that is affected; "" = all of the fault's
    kind."""
    value: float = 0.0
    """Size of the fault by kind: bias or saturation limit (m/s^2, rad/s), servo strength 0..1, delay or jitter in
    ticks, probability of loss, share of the recognised landmarks 0..1, relative error of the focal length, factor of
    `sensor_wrong`, n of `sensor_slow`, which delivers each n-th sample."""
    seed: int = 0

    @property
    def end_tick(self) -> int:
        """First control tick at which the fault is over: start and duration, at least one tick."""
        return self.start_tick + max(1, round(self.duration / TICK_S))

    def active(self, tick: int) -> bool:
        """Return True if the fault is active in control tick `tick`."""
        return self.start_tick <= tick < self.end_tick


class FaultBank:
    """Faults of a run, with their random streams and the sensor values and packets that they store."""

    def __init__(
        self, joints: tuple[str, ...], legs: tuple[str, ...], sensors: tuple[str, ...] = (*SENSORS, IMAGE)
    ) -> None:
        self._names = {"joint": joints, "leg": legs, "axis": IMU_AXES, "channel": CHANNELS, "": ()}
        self.equip(sensors)
        self.faults: list[Fault] = []
        self._random: list[np.random.Generator] = []
        self._held: dict[str, list[float]] = {}
        self._queues: dict[str, list[tuple[float, int, dict[str, Any]]]] = {}
        self.lost = 0

    def __bool__(self) -> bool:
        """Return True if any fault was ever planned: a run without faults pays nothing."""
        return bool(self.faults)

    def equip(self, sensors: tuple[str, ...]) -> None:
        """Set which of the sensors in `SENSORS` and `IMAGE` the robot has: faults of others are refused."""
        self._sensors = sensors
        self._names["sensor"] = tuple(name for name in SENSORS if name in sensors)

    @property
    def possible(self) -> tuple[str, ...]:
        """Return the kinds of faults for which the robot has a sensor."""
        return tuple(kind for kind in KINDS if not _needed(kind) or set(_needed(kind)) & set(self._sensors))

    def add(self, fault: Fault) -> None:
        """Plan a fault.

        Raises:
            FaultError: unknown kind or target, or a value out of range.
        """
        if fault.kind not in KINDS:
            raise FaultError("kind", f"got {fault.kind!r}, known are {', '.join(KINDS)}")
        if not (np.isfinite(fault.duration) and fault.duration > 0.0):
            raise FaultError("duration", f"must be > 0 s, got {fault.duration!r}")
        if fault.kind not in self.possible:
            needed, there = " or ".join(_needed(fault.kind)), ", ".join(self._sensors)
            raise FaultError("kind", f"{fault.kind} goes with {needed} only, the robot has {there}")
        self._indices(fault)
        if fault.kind == "sensor_delayed" and fault.target not in ("", *STAMPED):
            raise FaultError("target", f"sensor_delayed takes {', '.join(STAMPED)}, not {fault.target!r}: no own stamp")
        low, high = _limits(fault.kind)
        if not low <= fault.value <= high:
            raise FaultError("value", f"{fault.kind} takes {low:g} to {high:g}, got {fault.value!r}")
        self._random.append(random_stream(fault.seed, f"fault/{len(self.faults)}"))
        self.faults.append(fault)

    @property
    def packets(self) -> bool:
        """True if a fault that loses or delays packets was ever planned."""
        return any(f.kind.startswith("packet") or f.kind == "sensor_delayed" for f in self.faults)

    def _indices(self, fault: Fault) -> list[int]:
        names = self._names[_target_of(fault.kind)]
        if not names:
            if fault.target:
                raise FaultError("target", f"{fault.kind} takes none, got {fault.target!r}")
            return []
        found = [i for i, name in enumerate(names) if fault.target in ("", name, name.split("_")[0])]
        if not found:
            raise FaultError("target", f"got {fault.target!r}, known are {', '.join(names)}")
        return found

    def on(self, tick: int, *kinds: str) -> list[Fault]:
        """Return the faults of some kinds that act at a tick."""
        return [f for f in self.faults if f.kind in kinds and f.active(tick)]

    # --- servos -------------------------------------------------------------------------------------------------

    def changes_servos(self, tick: int) -> bool:
        """Return True if a servo fault begins or ends in this tick."""
        return any(f.kind.startswith("servo") and tick in (f.start_tick, f.end_tick) for f in self.faults)

    def servo_strength(self, tick: int) -> Array:
        """Return the factor of faults on gains and torque limit of each servo at a tick, (nj,), no unit; 1 = sound."""
        strength = np.ones(len(self._names["joint"]))
        for fault in self.on(tick, "servo_dead", "servo_weak"):
            strength[self._indices(fault)] *= 0.0 if fault.kind == "servo_dead" else fault.value
        return strength

    # --- sensors ------------------------------------------------------------------------------------------------

    def imu(self, tick: int, measured: Array, limit: Array) -> Array | None:
        """Return an inertial sample as the broken sensor gives it, (6,): m/s^2, then rad/s; None = no sample.

        Args:
            tick: now.
            measured: accelerometer and gyro of the intact sensor, (6,) m/s^2 and rad/s.
            limit: range of each axis, (6,), m/s^2 and rad/s; made smaller in place by a fault that saturates.
        """
        for fault in self.on(tick, "imu_bias"):
            measured = measured.copy()
            measured[self._indices(fault)] += fault.value
        for fault in self.on(tick, "imu_saturate"):
            i = self._indices(fault)
            limit[i] = np.minimum(limit[i], fault.value)
        measured = np.clip(measured, -limit, limit)
        measured = self._freeze("imu", bool(self.on(tick, "imu_freeze")), measured)
        return None if self.on(tick, "imu_drop") else measured

    def joints(self, tick: int, position: Array, current: Array, torque: Array) -> tuple[Array, Array, Array] | None:
        """Return position (nj,) rad, current (nj,) A, torque (nj,) Nm as broken sensors give them; None = no sample.

        `tick`: control tick; `position`, `current`, `torque`: those of intact sensors, in these shapes and units.
        """
        table = np.stack((position, current, torque))
        table = self._freeze("joints", bool(self.on(tick, "joints_freeze")), table.ravel()).reshape(table.shape)
        for n, fault in enumerate(self.faults):
            if fault.kind == "encoder_stuck":
                i = self._indices(fault)
                table[0, i] = self._freeze(f"encoder/{n}", fault.active(tick), table[0, i])
        return None if self.on(tick, "joints_drop") else (table[0], table[1], table[2])

    def contacts(self, tick: int, touch: NDArray[np.bool_], foot_of_sphere: NDArray[np.int64]) -> Any:
        """Return the foot switches as broken sensors give them, (P,) bool, True = closed; None = no sample.

        Args:
            tick: now.
            touch: switches of the P contact spheres as intact sensors give them, (P,) bool.
            foot_of_sphere: index of the foot of each sphere, (P,).
        """
        touch = touch.copy()
        for fault in self.on(tick, "foot_stuck_on", "foot_stuck_off"):
            touch[np.isin(foot_of_sphere, self._indices(fault))] = fault.kind == "foot_stuck_on"
        return None if self.on(tick, "contacts_drop") else touch

    # --- camera and ranger --------------------------------------------------------------------------------------

    def seen(
        self, tick: int, marks: list[Detection], goal: Detection | None, looks: Array
    ) -> tuple[list[Detection], Detection | None]:
        """Return the landmarks and the marker of the goal that the broken camera reports.

        Args:
            tick: now.
            marks: recognised landmarks.
            goal: marker of the goal, None = not seen.
            looks: descriptors of all landmarks, (n, d), no unit, from which mistaken ones are made.
        """
        for fault, rng in zip(self.faults, self._random, strict=True):
            if fault.kind == "landmarks_drop" and fault.active(tick):
                marks = [mark for mark in marks if rng.random() >= fault.value]
            elif fault.kind == "landmarks_false" and fault.active(tick):
                marks = [_mistaken(mark, looks, rng) if rng.random() < fault.value else mark for mark in marks]
        frozen = bool(self.on(tick, "camera_freeze"))
        marks = _unpacked(self._freeze("landmarks", frozen, _packed(marks)))
        markers = _unpacked(self._freeze("goal", frozen, _packed([] if goal is None else [goal])))
        if self.on(tick, "camera_dark"):
            return [], None
        return marks, markers[0] if markers else None

    def echo(self, tick: int, distance: float | None, shortest: float) -> tuple[float | None] | None:
        """Return the distance, m, that a broken ultrasound reports, as a tuple of one; None = no sample.

        Args:
            tick: control tick.
            distance: true distance, m; None = no echo.
            shortest: reading of a stuck sensor, m.
        """
        if self.on(tick, "range_drop"):
            return None
        return (shortest,) if self.on(tick, "range_stuck") else (distance,)

    def _freeze(self, key: str, frozen: bool, value: Array) -> Array:
        """Return the last value before the fault while it is on (`frozen`), else `value` (n,); `key`: of the sensor."""
        if frozen and key in self._held:
            return np.array(self._held[key])
        self._held[key] = value.tolist()
        return value

    def fail(self, tick: int, sensor: str, x: Array) -> Array | None:
        """Return the numbers of a sample, (n,), as its failed sensor gives them, in its own units; None = no sample.

        `sensor`: its name in SENSORS; `x`: numbers of the intact sensor, (n,). A switch is +1 or -1, so that a factor
        of -1 inverts it.
        """
        for n, (fault, rng) in enumerate(zip(self.faults, self._random, strict=True)):
            if fault.target not in ("", sensor):
                continue
            key, on = f"{fault.kind}/{n}/{sensor}", fault.active(tick)
            if fault.kind == "sensor_stuck":
                x = self._freeze(key, on and len(self._held.get(key, x)) == len(x), x)
            elif on and fault.kind == "sensor_garbage":
                x = rng.uniform(-1.0, 1.0, x.shape) * GARBAGE[sensor]
            elif on and fault.kind == "sensor_wrong":
                x = fault.value * x
            elif on and fault.kind == "sensor_slow":
                (count,) = self._held.get(key, [0.0])
                self._held[key] = [count + 1.0]
                if count % round(fault.value):
                    return None
            elif on and (
                fault.kind == "sensor_off" or (fault.kind == "sensor_intermittent" and rng.random() < fault.value)
            ):
                return None
        return x

    # --- packets ------------------------------------------------------------------------------------------------

    def packet(self, tick: int, channel: str, content: dict[str, Any] | None) -> dict[str, Any] | None:
        """Return the packet that arrives in a tick over a faulty line, None = none does.

        Lost packets are counted. Late ones wait in a queue; when several arrive in one tick the last one counts and the
        others are lost, as one key carries one sample a tick. `packet_reorder` delays each packet by a random time.

        Args:
            tick: now.
            channel: line: imu, joints, contacts or command.
            content: what was sent now, plain JSON values; None = nothing.
        """
        queue = self._queues.setdefault(channel, [])
        if content is not None:
            arrival, lost = float(tick), False
            for fault, rng in zip(self.faults, self._random, strict=True):
                if not fault.active(tick) or not self._on_line(fault, channel):
                    continue
                if fault.kind in ("packet_delay", "sensor_delayed"):
                    arrival += round(fault.value)
                elif fault.kind == "packet_reorder":
                    arrival += rng.uniform(0.0, fault.value)
                else:
                    lost |= rng.random() < fault.value
            if lost:
                self.lost += 1
            else:
                queue.append((arrival, tick, content))
        due = sorted((item for item in queue if item[0] <= tick), key=lambda item: item[:2])
        if not due:
            return None
        self._queues[channel] = [item for item in queue if item[0] > tick]
        self.lost += len(due) - 1
        return due[-1][2]

    def _on_line(self, fault: Fault, channel: str) -> bool:
        if fault.kind == "sensor_delayed":
            return channel in STAMPED and fault.target in ("", channel)
        return fault.kind.startswith("packet") and CHANNELS.index(channel) in self._indices(fault)

    # --- checkpoint ---------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Return faults, their random streams, stored values and queues, as plain JSON values."""
        return {
            "faults": [asdict(f) for f in self.faults],
            "random": [rng.bit_generator.state for rng in self._random],
            "held": dict(self._held),
            "queues": {key: [list(item) for item in queue] for key, queue in self._queues.items()},
            "lost": self.lost,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Set faults, random streams, stored values and queues to a `state` that was returned earlier."""
        self.faults = [Fault(**f) for f in state["faults"]]
        self._random = [np.random.default_rng() for _ in self.faults]
        for rng, saved in zip(self._random, state["random"], strict=True):
            rng.bit_generator.state = saved
        self._held = dict(state["held"])
        self._queues = {key: [(a, t, c) for a, t, c in queue] for key, queue in state["queues"].items()}
        self.lost = int(state["lost"])


def _mistaken(mark: Detection, looks: Array, rng: np.random.Generator) -> Detection:
    """Return a landmark with the descriptor of another one, drawn from `looks` (n, d); its noise is kept."""
    if len(looks) < 2 or mark.landmark < 0:
        return mark
    other = int(rng.integers(len(looks) - 1))
    other += other >= mark.landmark
    return mark._replace(descriptor=mark.descriptor + (looks[other] - looks[mark.landmark]))


def _packed(marks: list[Detection]) -> Array:
    """Return recognised landmarks as an array: count, then range (m), bearing (rad), index, descriptor of each."""
    rows = [np.array([mark.range, mark.bearing, mark.landmark, *mark.descriptor]) for mark in marks]
    return np.concatenate((np.array([float(len(rows))]), *rows))


def _unpacked(numbers: Array) -> list[Detection]:
    """Return the landmarks of an array: count, then range (m), bearing (rad), index, descriptor of each."""
    count = int(numbers[0])
    rows = numbers[1:].reshape(count, -1) if count else ()
    return [Detection(float(row[0]), float(row[1]), row[3:].copy(), int(row[2])) for row in rows]


def _target_of(kind: str) -> str:
    if kind.startswith("packet"):
        return "channel"
    if kind.startswith("sensor"):
        return "sensor"
    if kind in ("imu_bias", "imu_saturate"):
        return "axis"
    if kind.startswith("foot"):
        return "leg"
    return "joint" if kind.startswith(("servo", "encoder")) else ""


def _needed(kind: str) -> tuple[str, ...]:
    """Return the sensors of which the robot needs one for a kind of fault; empty = every robot has it."""
    if kind in ("camera_dark", "camera_freeze"):
        return "landmarks", IMAGE
    if kind.startswith("camera"):
        return (IMAGE,)
    return tuple(name for name in ("landmarks", "range") if kind.startswith(name))


def _limits(kind: str) -> tuple[float, float]:
    if kind == "imu_bias":
        return -1000.0, 1000.0
    if kind == "imu_saturate":
        return 0.0, 1000.0
    if kind == "camera_zoom":
        return -0.5, 1.0
    if kind == "sensor_wrong":
        return -10.0, 10.0
    if kind == "sensor_slow":
        return 2.0, float(MAX_DELAY_TICKS)
    if kind in ("sensor_intermittent", "servo_weak", "packet_loss", "landmarks_false", "landmarks_drop"):
        return 0.0, 1.0
    return 0.0, float(MAX_DELAY_TICKS)
