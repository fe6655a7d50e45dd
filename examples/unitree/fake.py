"""A Go2 that is none: publishes `rt/lowstate` over DDS on loopback at 500 Hz, standing still."""

import sys
import time

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from surefoot.services.unitree.messages import (
    LOW_STATE,
    ON_INTERFACE,
    BatteryState,
    ImuState,
    LowState,
    MotorState,
    check_sum,
    memory_of,
)

HOME = (0.0, 0.9, -1.8)  # hip, thigh, calf, rad


def low_state(tick_ms: int, joints: list[float], gyro: list[float], acc: list[float], force: list[int]) -> LowState:
    """Return a message with its check sum; motors and feet in the maker's order."""
    motors = [MotorState(1, q, 0.0, 0.0, 0.0, q, 0.0, 0.0, 30, 0, [0, 0]) for q in [*joints, *[0.0] * 8][:20]]
    battery = BatteryState(1, 0, 8, 90, -1000, 5, [30, 30], [30, 30], [3800] * 15)
    made = LowState(
        [254, 239], 255, 0, [0, 0], [0, 0], 0, ImuState([1.0, 0.0, 0.0, 0.0], gyro, acc, [0.0] * 3, 40), motors,
        battery, force, force, tick_ms, [0] * 40, 0, 0.0, 40, 40, 29.0, 1.0, [0] * 4, 0, 0,
    )  # fmt: skip
    made.crc = check_sum(memory_of(made))
    return made


def main(domain: int, seconds: float) -> None:
    """Publish for so many seconds."""
    loopback = Domain(domain, ON_INTERFACE.format("lo"))  # else DDS takes the first network it finds
    participant = DomainParticipant(loopback.domain_id)
    writer = DataWriter(participant, Topic(participant, LOW_STATE, LowState))
    began = time.monotonic()
    for k in range(round(500 * seconds)):
        writer.write(low_state(2 * k, [*HOME] * 4, [0.0, 0.0, 0.0], [0.0, 0.0, 9.81], [60] * 4))
        time.sleep(max(0.0, began + 0.002 * (k + 1) - time.monotonic()))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 0, float(sys.argv[2]) if len(sys.argv) > 2 else 60.0)
