"""A runtime without a bus, for tests of services."""

from typing import Any


class Stage:
    """Keeps what a service publishes and logs; a request is a failure."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, Any]] = []
        """Keys and messages in the order of publication."""
        self.logged: list[str] = []

    @property
    def said(self) -> dict[str, Any]:
        """Last message of each key."""
        return dict(self.sent)

    def of(self, key: str) -> list[Any]:
        """Messages of a key."""
        return [message for sent, message in self.sent if sent == key]

    def publish(self, topic: Any, message: Any, stamp_ns: int | None) -> None:
        self.sent.append((topic.key, message))

    def call(self, query: Any, request: Any, timeout_s: float | None) -> Any:
        raise AssertionError(query.key)

    def log(self, level: str, text: str) -> None:
        self.logged.append(f"{level}: {text}")
