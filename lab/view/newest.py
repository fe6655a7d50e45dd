"""Scene of a running system, built from the newest message of each topic."""

import threading
from collections.abc import Callable
from contextlib import suppress

from surefoot.bus.interface import Delivery
from surefoot.client import Client
from surefoot.errors import CallError, SurefootError
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.reader import load_robot
from surefoot.schemas.topics import TOPICS

from ..scene.scene import KEYS, RobotScene, Snapshot

FRAME_S = 1.0 / 30.0
"""Wall time between two frames of the live view, s."""
TRUTH = "sim/truth"
SENSED = ("hw/joints", "hw/contacts")
"""Keys of which a scene needs no message while messages of the truth come: those state the same, exactly."""
CLOCK = "hw/joints"
"""Key of a topic that every driver publishes; a new epoch or a step back of its stamps shows a new run."""
ASK_S = 2.0
"""Longest wall time to wait for a driver's reply on maps, features or robot description, s."""


def robot_behind(client: Client, name: str | None, warn: Callable[[str], None]) -> Robot:
    """Return the robot of a running system: by `name`, else as its driver reports, else by the prefix of its keys.

    Args:
        client: client connected to the system.
        name: name or folder of the robot; None = as the driver reports.
        warn: called with a sentence if the driver uses another description.

    Raises:
        SurefootError: the robot is not known here.
    """
    try:
        driver = client.call("hw/description", ASK_S)
    except CallError:
        driver = None
    wanted = name or (client.bus.endpoint.namespace.rpartition("/")[2] if driver is None else driver.robot)
    try:
        robot = load_robot(wanted)
    except RobotError as error:
        raise SurefootError(error.code, f"{error}; --robot names the folder of another", "robot") from None
    if driver is not None and driver.hash != robot.hash:
        warn(f"the driver was built from another description of {driver.robot} than {wanted}; --robot names its folder")
    return robot


class NewestScene:
    """Scene of a running system, updated with the newest message of each topic when `look` is called.

    Attributes:
        scene: scene of the robot; hold `lock` to read it.
        grounds: number of ground maps that the scene has had.
        runs: number of runs seen: resets and starts of a driver.
    """

    def __init__(
        self, client: Client, robot: Robot, also: Callable[[Delivery], object] = lambda _: None,
        begins: Callable[[], object] = bool,
    ) -> None:  # fmt: skip
        """Subscribe to topics; `look` calls `also` with each message that it reads, and `begins` before a new run."""
        self.client, self.scene, self.lock = client, RobotScene(robot), threading.Lock()
        self._also, self._begins = also, begins
        self.grounds, self._ground = 0, self.scene.ground
        self.runs, self._stamp = 0, (-1, 0)
        self._newest = [client.bus.newest(topic) for topic in TOPICS if topic.key in KEYS]

    def ask_for_maps(self) -> None:
        """Request the driver's height map and landmarks, which may have been published before this view subscribed."""
        keys = ["terrain/map"] if self.scene.ground is None else []
        keys += ["terrain/landmarks"] if self.scene.robot.camera and not self.scene.marks else []
        for key in keys:
            with suppress(SurefootError):  # a driver without a map
                reply = self.client.call(key, ASK_S)
                with self.lock:
                    self.scene.feed(key, lambda reply=reply: reply)

    def look(self) -> tuple[bool, Snapshot | None]:
        """Update the scene; return (True if there were new messages, snapshot). The caller holds `lock`."""
        found = [newest() for newest in self._newest]
        came = [delivery for delivery in found if delivery is not None and not delivery.prime]
        unused = SENSED if self.scene.true and any(each.key == TRUTH for each in came) else ()
        for delivery in came:
            self._count_runs(delivery)
            if delivery.key not in unused:
                self.scene.feed(delivery.key, delivery.message)
            self._also(delivery)
        snapshot = self.scene.snapshot()
        if self.scene.ground is not self._ground:
            self._ground, self.grounds = self.scene.ground, self.grounds + 1
        return bool(came), snapshot

    def _count_runs(self, delivery: Delivery) -> None:
        """Count a new run when the epoch of a `hw/joints` message rises, or its epoch or stamp goes back."""
        if delivery.key != CLOCK:
            return
        with suppress(SurefootError):
            header = delivery.header()
            now = header.epoch, header.stamp_ns
            if now[0] > self._stamp[0] or now < self._stamp:
                self.runs += 1
                if self._stamp[0] >= 0:
                    self._begins()
            if now < self._stamp:  # not by a reset, which raises the epoch
                self.scene.forget()
            self._stamp = now
