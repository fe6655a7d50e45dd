"""A runtime without a bus and the messages that a walker reads, for tests of the walker service."""

from typing import Any

import numpy as np

from surefoot.errors import CallError
from surefoot.lockstep.join import TickInputs
from surefoot.schemas.footholds import LegFoothold, SelectReply
from surefoot.schemas.hw import FootContacts, JointState, Tick
from surefoot.schemas.state import Odometry, VelocityEstimate
from surefoot.schemas.topics import HW_CONTACTS, HW_JOINTS, STABILITY_CHECK, STATE_ODOMETRY, STATE_VELOCITY
from surefoot.services.walker.service import SERVICE, WalkerConfig
from tests.services.stage import Stage

EPOCH = 3
ZERO = (0.0, 0.0, 0.0)


class Walked(Stage):
    """Keeps requests, too; footholds are as wished, stability is absent."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[str, Any]] = []

    def call(self, query: Any, request: Any, timeout_s: float | None) -> Any:
        self.asked.append((query.key, request))
        if query.key == STABILITY_CHECK.key:
            raise CallError("absent", "stability is not on the roster")
        legs = tuple(LegFoothold(leg=leg.leg, status="ok", foothold=leg.nominal) for leg in request.legs)
        return SelectReply(legs=legs, map_version=0, model="test")


def service_of(**config: Any) -> Any:
    """A walker service that has started on a stage."""
    service = SERVICE(WalkerConfig(**config))
    service.attach(Walked())
    service.on_start()
    return service


def head(tick: int) -> dict[str, Any]:
    """The fields that all messages of a tick of 10 ms have."""
    return {"stamp_ns": tick * 10_000_000, "tick": tick, "epoch": EPOCH, "seq": 0, "source": "test"}


def tick_of(tick: int, messages: dict[str, Any], roster: tuple[str, ...], held: bool = False) -> TickInputs:
    """The inputs of a tick."""
    return TickInputs(Tick(**head(tick), roster=roster, roster_version=1, due=(), mode="lockstep", held=held), messages)


def samples(tick: int, joints: np.ndarray, touch: tuple[tuple[bool, ...], ...]) -> dict[str, Any]:
    """Joint angles, rad, and switches of each foot."""
    return {
        HW_JOINTS.key: JointState(**head(tick), position=tuple(joints.tolist())),
        HW_CONTACTS.key: FootContacts(**head(tick), touch=touch, normal_force_n=(None,) * len(touch)),
    }


def estimate(
    tick: int, pose: tuple[float, float, float], feet: int, ready: bool = True, **motion: Any
) -> dict[str, Any]:
    """An estimate at rest at (x, y, yaw), m and rad, but for `motion`: roll, pitch, angular_velocity."""
    motion = {"angular_velocity": ZERO, "roll": 0.0, "pitch": 0.0} | motion
    return {
        STATE_ODOMETRY.key: Odometry(
            **head(tick), position=(*pose[:2], 0.0), quat_wxyz=(1.0, 0.0, 0.0, 0.0), yaw=pose[2], velocity=ZERO,
            covariance=(0.0,) * 16, initialised=ready,
        ),
        STATE_VELOCITY.key: VelocityEstimate(
            **head(tick), **motion, mode="ekf", velocity=ZERO, velocity_imu=ZERO, velocity_heading=ZERO,
            g_up=(0.0, 0.0, 9.81), gyro_bias=ZERO, covariance=(0.0,) * 36, initialised=ready, standing=False,
            inputs_ok=True, filter_ok=True, sensors_ok=True, slipping=(False,) * feet,
        ),
    }  # fmt: skip
