"""Paths that select numbers in the messages of a log: `/topic.field.field[a:b]`."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError

PATTERN = re.compile(r"(?P<topic>[^.\[\]]+)(?P<fields>(\.\w+)*)(\[(?P<first>\d{1,9}):(?P<end>\d{1,9})\])?")
USUAL = ("data", "contacts", "foot_force", "effort")
"""Names of message fields with one number per foot, which are tried in this order if a path names no field."""


@dataclass(frozen=True)
class FieldPath:
    """Path to numbers in a log: a topic, a (nested) field of its messages, and optionally a slice of that array."""

    topic: str
    fields: tuple[str, ...] = ()  # empty = the first of `USUAL`
    part: tuple[int, int] | None = None

    @classmethod
    def of(cls, text: str) -> "FieldPath":
        """Return the path written as `TOPIC`, `TOPIC.FIELD` or `TOPIC.FIELD[a:b]` (raises SurefootError)."""
        found = PATTERN.fullmatch(text)
        if found is None:
            raise SurefootError("invalid", f"got {text!r}; wanted is TOPIC, TOPIC.FIELD or TOPIC.FIELD[a:b]", text)
        fields = tuple(found["fields"].split(".")[1:])
        part = None if found["first"] is None else (int(found["first"]), int(found["end"]))
        if part is not None and part[0] >= part[1]:
            raise SurefootError("invalid", f"got {text!r}; the part [a:b] is empty", text)
        return cls(found["topic"], fields, part)

    @property
    def named(self) -> bool:
        """True if the path has no slice `[a:b]`: then a list of names in the message applies to the numbers."""
        return self.part is None

    def values(self, message: Any) -> NDArray[Any]:
        """Return the numbers that this path selects in a message, (k,), in the unit of the log.

        Raises:
            SurefootError: the message has no such field, or it holds no numbers.
        """
        fields = self.fields or tuple(name for name in USUAL if np.size(getattr(message, name, ())))[:1]
        at = message
        for name in fields:
            if not hasattr(at, name):
                known = ", ".join(word for word in dir(message) if not word.startswith("_"))
                text = f"{self.topic} has no field {name!r}; there are {known}"
                raise SurefootError("invalid", text, self.topic)
            at = getattr(at, name)
        if not fields:
            text = f"{self.topic} has none of the fields {', '.join(USUAL)}; name one: {self.topic}.FIELD"
            raise SurefootError("invalid", text, self.topic)
        try:
            values = np.atleast_1d(np.asarray(at))
        except ValueError:  # lists of different lengths
            values = np.array([None])
        if values.ndim != 1 or values.dtype.kind not in "biuf":
            raise SurefootError("invalid", f"{self.topic}.{'.'.join(fields)} holds no numbers", self.topic)
        return values if self.part is None else values[slice(*self.part)]
