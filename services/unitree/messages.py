"""DDS types of Unitree's quadrupeds (`unitree_go`: Go1, Go2, B2), and their check sum."""
# pyright: reportGeneralTypeIssues=false
# (cyclonedds types arrays by a marker class; their values are lists)

import struct
import zlib
from array import array as words_of
from dataclasses import dataclass
from typing import NamedTuple

import cyclonedds.idl as idl
import numpy as np
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, float32, int16, int32, uint8, uint16, uint32
from numpy.typing import NDArray

LOW_STATE, SPORT_STATE = "rt/lowstate", "rt/sportmodestate"
"""DDS topics: `LOW_STATE`: sensors of the robot; `SPORT_STATE`: state estimate of the manufacturer's controller."""
BATTERY_AND_REST = "4BiH4B15H" + "8hI41B3xf2B2x2f4H2I"
PACKED = "<4B4IH2x" + "13fB3x" + "B3x7fB3x3I" * 20 + BATTERY_AND_REST
"""Format of `struct` for a LowState as it lies in the robot's memory, over which its check sum is computed."""
SENT, SENT_AS = "<4x4B4IH2x" + "13fB" + "B2x7fB3x3I" + "B3x7fB3x3I" * 19 + BATTERY_AND_REST, b"\0\1"
"""`SENT`: format of `struct` for a LowState as DDS carries it; `SENT_AS`: first two bytes of such a message: XCDR1,
little-endian."""
READ = struct.Struct("<40x3f3f16x" + "4x2f4xf16xI8x" * 20 + "44x4h8xI72xI")
"""Format of the numbers of `Sensors` in the robot's memory."""
ON_INTERFACE = (
    "<CycloneDDS><Domain><General><Interfaces>"
    '<NetworkInterface name="{}" presence_required="true"/>'
    "</Interfaces></General></Domain></CycloneDDS>"
)
"""Settings of a DDS domain on one network interface, whose name is to be filled in; by default DDS chooses one."""
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Table of all 256 bytes with their bits in reverse order, by index."""


@dataclass
@final
@autoid("sequential")
class ImuState(idl.IdlStruct, typename="unitree_go.msg.dds_.IMUState_"):
    """Inertial unit: quaternion w, x, y, z; angular velocity, rad/s; acceleration, m/s^2; roll, pitch, yaw, rad."""

    quaternion: array[float32, 4]
    gyroscope: array[float32, 3]
    accelerometer: array[float32, 3]
    rpy: array[float32, 3]
    temperature: uint8


@dataclass
@final
@autoid("sequential")
class MotorState(idl.IdlStruct, typename="unitree_go.msg.dds_.MotorState_"):
    """State of one motor: angle, rad, speed, rad/s, torque at the joint, Nm; `lost` counts missing answers."""

    mode: uint8
    q: float32
    dq: float32
    ddq: float32
    tau_est: float32
    q_raw: float32
    dq_raw: float32
    ddq_raw: float32
    temperature: uint8
    lost: uint32
    reserve: array[uint32, 2]


@dataclass
@final
@autoid("sequential")
class BatteryState(idl.IdlStruct, typename="unitree_go.msg.dds_.BmsState_"):
    """State of the robot's battery, as DDS carries it."""

    version_high: uint8
    version_low: uint8
    status: uint8
    soc: uint8
    current: int32
    cycle: uint16
    bq_ntc: array[uint8, 2]
    mcu_ntc: array[uint8, 2]
    cell_vol: array[uint16, 15]


@dataclass
@final
@autoid("sequential")
class LowState(idl.IdlStruct, typename="unitree_go.msg.dds_.LowState_"):
    """Sensor message at 500 Hz; motors and feet in the manufacturer's order, `tick` in ms."""

    head: array[uint8, 2]
    level_flag: uint8
    frame_reserve: uint8
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    imu_state: ImuState
    motor_state: array[MotorState, 20]
    bms_state: BatteryState
    foot_force: array[int16, 4]
    foot_force_est: array[int16, 4]
    tick: uint32
    wireless_remote: array[uint8, 40]
    bit_flag: uint8
    adc_reel: float32
    temperature_ntc1: uint8
    temperature_ntc2: uint8
    power_v: float32
    power_a: float32
    fan_frequency: array[uint16, 4]
    reserve: uint32
    crc: uint32


@dataclass
@final
@autoid("sequential")
class TimeSpec(idl.IdlStruct, typename="unitree_go.msg.dds_.TimeSpec_"):
    """Time stamp of the manufacturer's state estimate: seconds and nanoseconds."""

    sec: int32
    nanosec: uint32


@dataclass
@final
@autoid("sequential")
class PathPoint(idl.IdlStruct, typename="unitree_go.msg.dds_.PathPoint_"):
    """Point of a path planned by the manufacturer's software: time, s; position, m; heading, rad; their rates."""

    t_from_start: float32
    x: float32
    y: float32
    yaw: float32
    vx: float32
    vy: float32
    vyaw: float32


@dataclass
@final
@autoid("sequential")
class SportModeState(idl.IdlStruct, typename="unitree_go.msg.dds_.SportModeState_"):
    """State estimate by the manufacturer's controller: pose and velocity (m, m/s, rad/s), gait, feet, planned path."""

    stamp: TimeSpec
    error_code: uint32
    imu_state: ImuState
    mode: uint8
    progress: float32
    gait_type: uint8
    foot_raise_height: float32
    position: array[float32, 3]
    body_height: float32
    velocity: array[float32, 3]
    yaw_speed: float32
    range_obstacle: array[float32, 4]
    foot_force: array[int16, 4]
    foot_position_body: array[float32, 12]
    foot_speed_body: array[float32, 12]
    path_point: array[PathPoint, 10]


def _carried(layout: str) -> NDArray[np.int64]:
    """Return the positions of the bytes that are no padding in a format of `struct`."""
    ones = struct.unpack(layout, b"\1" * struct.calcsize(layout))
    return np.flatnonzero(np.frombuffer(struct.pack(layout, *ones), np.uint8))


SENT_AT = np.zeros(struct.calcsize(PACKED), dtype=np.int64)
"""Position of each byte of the robot's memory in a message of DDS; 0, where `SENT_AS` has a zero, for padding."""
SENT_AT[_carried(PACKED)] = _carried(SENT)


class Memory(bytes):
    """A LowState as it lies in the robot's memory, in the format `PACKED`."""


class MemoryAsSent:
    """Fast decoder of LowState messages for a `Topic`: a few calls in C instead of one in Python for each field."""

    deserialize_key = LowState.deserialize_key

    @staticmethod
    def deserialize(data: bytes) -> Memory:
        """Return a LowState message as it lies in the robot's memory, from the bytes that DDS carries."""
        if len(data) == len(SENT_AT) and data[:2] == SENT_AS:
            return Memory(np.frombuffer(data, np.uint8)[SENT_AT].tobytes())
        return memory_of(LowState.deserialize(data))


class Sensors(NamedTuple):
    """Numbers of a LowState that a driver reads: rad, rad/s, Nm, m/s^2; motors and feet in the manufacturer's order."""

    tick: int  # ms
    crc: int
    gyroscope: tuple[float, ...]  # (3,)
    accelerometer: tuple[float, ...]  # (3,)
    foot_force: tuple[float, ...]  # (4,) raw
    q: tuple[float, ...]  # (20,)
    dq: tuple[float, ...]  # (20,)
    tau_est: tuple[float, ...]  # (20,)
    lost: tuple[float, ...]  # (20,)


def sensors_of(memory: Memory) -> Sensors:
    """Return the sensors of a robot from its LowState message."""
    n = READ.unpack(memory)
    motors = n[6:-6]
    return Sensors(n[-2], n[-1], n[:3], n[3:6], n[-6:-2], motors[::4], motors[1::4], motors[2::4], motors[3::4])


def memory_of(state: LowState) -> Memory:
    """Return a LowState message as it lies in the robot's memory."""
    m, imu, power = state, state.imu_state, state.bms_state
    numbers = [*m.head, m.level_flag, m.frame_reserve, *m.sn, *m.version, m.bandwidth]
    numbers += [*imu.quaternion, *imu.gyroscope, *imu.accelerometer, *imu.rpy, imu.temperature]
    for r in m.motor_state:
        numbers += (r.mode, r.q, r.dq, r.ddq, r.tau_est, r.q_raw, r.dq_raw, r.ddq_raw, r.temperature, r.lost)
        numbers += r.reserve
    numbers += [power.version_high, power.version_low, power.status, power.soc, power.current, power.cycle]
    numbers += [*power.bq_ntc, *power.mcu_ntc, *power.cell_vol, *m.foot_force, *m.foot_force_est, m.tick]
    numbers += [*m.wireless_remote, m.bit_flag, m.adc_reel, m.temperature_ntc1, m.temperature_ntc2]
    return Memory(struct.pack(PACKED, *numbers, m.power_v, m.power_a, *m.fan_frequency, m.reserve, m.crc))


def check_sum(memory: Memory) -> int:
    """Return the check sum of a LowState: CRC-32/MPEG-2 over all its words but the last."""
    words = words_of("I", memory.translate(REVERSED))
    words.byteswap()
    reflected = zlib.crc32(memoryview(words)[:-1]) ^ 0xFFFFFFFF
    return int.from_bytes(reflected.to_bytes(4, "little").translate(REVERSED), "big")
