"""Line of commands to the servos, which rounds set-points to their resolution and delays them by their latency."""

from typing import Any, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.robot.description import Robot

from .samples import ServoCommand, pack, unpack

EXACT = 1e-9  # rad, step of a servo that takes any set-point, beside others that do not


class Arrival(NamedTuple):
    """Command that arrives at the servos in a physics step, with set-points rounded to their resolution."""

    step: int
    """Number of the physics step in which the command takes effect, counted from the reset."""
    command: ServoCommand


class ServoLine:
    """Queue of servo commands that rounds set-points and delays them by whole physics steps.

    Args:
        robot: its servos' resolution counts for each joint, the longest latency for all.
        step_ns: length of a physics step, ns.
    """

    def __init__(self, robot: Robot, step_ns: int) -> None:
        servos = [joint.servo for joint in robot.joints]
        coarse = any(servo.resolution for servo in servos)
        self.resolution = np.array([servo.resolution or EXACT for servo in servos]) if coarse else None
        self.latency_steps = round(max(servo.latency for servo in servos) * 1e9) // step_ns
        self.clear()

    def clear(self) -> None:
        """Drop the commands that have not reached the servos."""
        self._coming: list[Arrival] = []

    def heard(self, set_points: Array) -> Array:
        """Return set-points (nj,) rad rounded to the resolution of each servo, as the servos receive them."""
        if self.resolution is None:
            return set_points
        return self.resolution * np.rint(set_points / self.resolution)

    def send(self, step: int, command: ServoCommand) -> None:
        """Put a command, sent in a physics step, on the line to the servos; it arrives later by their latency."""
        heard = self.heard(command.position)
        self._coming.append(Arrival(step + self.latency_steps, ServoCommand(heard, command.torque_limit)))

    def arrival(self, until: int) -> Arrival | None:
        """Return the next command that arrives up to a physics step; None = no more."""
        return self._coming.pop(0) if self._coming and self._coming[0].step <= until else None

    def state(self, step: int) -> list[Any]:
        """Return the commands that have not arrived, their steps counted from `step`, as plain JSON values."""
        return [[at - step, pack(command)] for at, command in self._coming]

    def restore(self, step: int, state: list[Any]) -> None:
        """Set the commands that have not arrived to an earlier returned `state`, its steps counted from `step`."""
        self._coming = [Arrival(step + ahead, unpack(ServoCommand, command)) for ahead, command in state]
