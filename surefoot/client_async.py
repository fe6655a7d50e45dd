"""The public client for programs on `asyncio`; apart from `client`, whose import time `asyncio` would double."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any, Self

from surefoot.client import Client, connect
from surefoot.schemas.rows import M
from surefoot.schemas.topics import Query, Topic


class AsyncClient:
    """A `Client` for programs that run on `asyncio`: waiting never blocks the loop."""

    def __init__(self, client: Client) -> None:
        self.client = client

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.client.close)

    async def call(self, query: Query[Any, Any] | str, timeout_s: float | None = None, **fields: Any) -> Any:
        """Send a request with these `fields` to the owner of a query, given by its key or row, and return its reply.

        `timeout_s`: longest wait, s of wall time, None = that of the query. Raises SurefootError (no such query or
        field), CallError (no reply, or a refusal) or BusError (the client is closed).
        """
        return await asyncio.to_thread(self.client.call, query, timeout_s, **fields)

    def messages(self, topic: Topic[M] | str, timeout_s: float | None = 5.0) -> AsyncIterator[M]:
        """Return an asynchronous iterator over the messages of a topic, given by its key or row.

        It ends when no message comes for `timeout_s` s of wall time (None = never). An unknown topic, an invalid
        wait or a closed client raises SurefootError at once.
        """
        self.client.messages(topic, timeout_s)  # checks; nothing is subscribed before it is read
        return self._messages(topic, timeout_s)

    async def _messages(self, topic: Topic[M] | str, timeout_s: float | None) -> AsyncIterator[M]:
        loop, queue = asyncio.get_running_loop(), asyncio.Queue[M | None]()

        def take(message: M | None) -> None:
            with suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(queue.put_nowait, message)

        def close() -> None:
            take(None)

        end = self.client.subscribe(topic, take)
        self.client.waiting.add(close)
        try:
            while (message := await asyncio.wait_for(queue.get(), timeout_s)) is not None:
                yield message
        except TimeoutError:
            return
        finally:
            self.client.waiting.discard(close)
            end()

    async def latest(self, topic: Topic[M] | str, timeout_s: float | None = 5.0) -> M:
        """Return the next message of a topic, given by its key or row; `timeout_s`: longest wait, s of wall time.

        None = no limit. Raises SurefootError (no such topic), CallError (no message came) or BusError (closed).
        """
        return await asyncio.to_thread(self.client.latest, topic, timeout_s)


async def connect_async(robot: str = "ragno", endpoint: str | None = None, fleet: str = "surefoot") -> AsyncClient:
    """Join the network as a client from a program on `asyncio`.

    Args:
        robot: second part of the keys' prefix.
        endpoint: that of the router; None = SUREFOOT_CONNECT, else SUREFOOT_LISTEN, else ``tcp/127.0.0.1:7447``.
        fleet: first part of the keys' prefix.

    Raises:
        FieldError: `robot` or `fleet` is no name that keys can hold; the name of a robot that does not run is one.
        BusError: no router answers.
        ConfigError: the value given is no endpoint.
    """
    return AsyncClient(await asyncio.to_thread(connect, robot, endpoint, fleet))
