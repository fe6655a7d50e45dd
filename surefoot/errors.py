"""Failures with a code: each names the received value, the allowed ones and the field."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.schemas.base import ErrorReply


class SurefootError(Exception):
    """Base of the errors a user may see; ``str()`` is one sentence."""

    def __init__(self, code: str, message: str, field: str | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.field = field

    def reply(self) -> "ErrorReply":
        """Return the error as a reply on the wire."""
        from surefoot.schemas.base import ErrorReply  # here: whoever only raises needs no models

        return ErrorReply(code=self.code, message=self.message[:2000], field=self.field)


class Refusal(SurefootError):
    """Bad input: counted under its code, answered or logged; the service goes on."""


class CallError(SurefootError):
    """A query that brought no reply: ``absent``, ``timeout``, or the server's own refusal."""


class ConfigError(SurefootError):
    """A configuration that cannot be used; names the file or source and the field."""


class BusError(SurefootError):
    """The bus could not be opened: busy port, no router, closed session."""
