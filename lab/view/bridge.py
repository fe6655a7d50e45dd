"""Live bridge to Foxglove, Lichtblick and rerun: serves the scene of a running system on a local WebSocket."""

import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any

from surefoot.bus.interface import Delivery
from surefoot.client import Client
from surefoot.errors import BusError, SurefootError
from surefoot.robot.description import Robot
from surefoot.schemas.topics import LOG

from ..scene.foxglove import FoxgloveScene
from ..scene.primitives import sdk
from .door import Door, hidden_address
from .newest import FRAME_S, NewestScene
from .server import HOST

PORT = 8765
"""TCP port to which Foxglove and Lichtblick connect by default."""
LINES = 100
"""Largest number of log lines that wait for the next frame; the oldest are dropped."""


class FoxgloveBridge:
    """Publisher of the scene of a running system to Foxglove clients, which can only read, until it is closed.

    Attributes:
        port: port on 127.0.0.1 at which clients connect.
    """

    def __init__(self, client: Client, robot: Robot, port: int = PORT) -> None:
        """Start the Foxglove server behind a `Door` on 127.0.0.1 and publish the robot's scene there.

        Raises:
            SurefootError: the library is missing.
            BusError: the port is taken.
        """
        library = sdk()
        self._newest, self._again, self._closed = NewestScene(client, robot), threading.Event(), threading.Event()
        self._context = library.Context()  # kept: its channels close with it
        self._to = FoxgloveScene(self._newest.scene, self._context)
        self._lines: deque[Delivery] = deque(maxlen=LINES)
        name = client.bus.endpoint.namespace
        self._server = library.start_server(
            name=name, host=(place := hidden_address()), port=0, context=self._context,
            server_listener=_Newcomers(self._again),
        )  # fmt: skip
        try:
            self._door = Door(port, (place, int(self._server.port)))
        except BusError:
            self._server.stop()
            raise
        self.port = self._door.port
        client.bus.subscribe(LOG, self._lines.append)
        self._thread = threading.Thread(target=self._run, name="bridge", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the WebSocket to which Foxglove connects, with the token."""
        return f"ws://{HOST}:{self.port}/?token={self._door.token}"

    def close(self) -> None:
        """Stop publishing, and disconnect the clients."""
        self._closed.set()
        self._thread.join(timeout=2.0)
        self._door.close()
        self._server.stop()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._closed.wait(max(0.0, due - time.monotonic())):
            due = max(due + FRAME_S, time.monotonic())
            news = self._again.is_set()
            if news:
                self._again.clear()
                self._newest.ask_for_maps()
                self._to.again()
            with self._newest.lock:
                came, snapshot = self._newest.look()
            if snapshot is not None and (came or news):
                self._to.publish(snapshot)
            while self._lines:
                self._log(self._lines.popleft())

    def _log(self, delivery: Delivery) -> None:
        if not delivery.prime:
            with suppress(SurefootError):
                line: Any = delivery.message()
                self._to.log(line.stamp_ns, line.level, line.source, line.text)


class _Newcomers:
    """Server listener that sets an event when a client subscribes, so that footprints and landmarks are sent again."""

    def __init__(self, again: threading.Event) -> None:
        self._note = again

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Set the event: a client subscribed to a channel, and needs the items that are published only once."""
        self._note.set()

    def __getattr__(self, name: str) -> Any:
        """Return a callback that does nothing, for all kinds of server events but subscriptions."""
        return lambda *_: None
