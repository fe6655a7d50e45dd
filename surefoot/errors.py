"""Exceptions with a code, whose text names the received value, the allowed values and the field."""

import reprlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from surefoot.schemas.base import ErrorReply

EXIT_USAGE = 2
"""Exit code of a command or service whose arguments, files or configuration cannot be used. The supervisor does not
start a process again that ends with it before it was ever healthy."""


class SurefootError(Exception):
    """Base of all errors that the library reports to users; ``str()`` is one sentence, on one line."""

    def __init__(self, code: str, message: str, field: str | None = None) -> None:
        self.message = printable(message)
        super().__init__(self.message)
        self.code = code
        self.field = field

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle needs to make the error again in another process, as one of a pool."""
        return _blank, (type(self), *self.args), self.__dict__

    def reply(self) -> "ErrorReply":
        """Return the error as the message that a service sends when it refuses a query."""
        from surefoot.schemas.base import ErrorReply  # here: whoever only raises needs no models

        return ErrorReply(code=self.code, message=self.message[:2000], field=self.field)


def _blank(kind: type[SurefootError], *args: Any) -> SurefootError:
    """Return an error of a kind with the arguments of an exception, whose attributes are still to be set."""
    return kind.__new__(kind, *args)


class FieldError(SurefootError, ValueError):
    """Error of an argument or a field that cannot be used; ``str()`` begins with the field.

    Attributes:
        code: kind of the fault, as in `shape`, `not_finite`, `range`.
        field: dotted path of the field.
        message: the received value and the allowed ones, without the field.
    """

    field: str

    def __init__(self, code: str, field: str, message: str) -> None:
        super().__init__(code, f"{field}: {message}", field)
        self.message = printable(message)


class InvalidField(FieldError):
    """A `FieldError` of code `invalid`."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__("invalid", field, message)


class Refusal(SurefootError):
    """Error of bad input to a service, which counts it under its code, answers or logs it, and goes on."""


class CallError(SurefootError):
    """Error of a query without a reply: ``absent`` (no service), ``timeout``, or the code of the service's refusal."""


class ConfigError(SurefootError):
    """Error of a configuration that cannot be used; the text names the file or source and the field."""


class BusError(SurefootError):
    """Error of a bus that cannot be opened or used: busy port, no router, closed session."""


def printable(text: str) -> str:
    """Return a text with what no terminal shows, as a line's end or a byte of a file's name, in Python's escapes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def shown(value: Any) -> str:
    """Return a shortened one-line text of a value, for error messages."""
    return " ".join(reprlib.repr(value).split())
