"""Inputs of the fuzzer: values drawn from JSON Schemas, damage to values and bytes, and the count of their ends."""

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Any

from surefoot.errors import SurefootError

SLOW_S = 2.0
"""Processor time of one input, s, above which it is a finding: what hangs takes more, on a slow machine as well."""
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**53 + 1, 2**63, 2**64, -(2**63) - 1, 10**400, 0.5, -0.0, 1e308, 1e-320, "",
    "x", "0", "\x00", "é\ud800"[:1], "a" * 5000, [], [[]], {}, {"x": 1}, [None], [1e308, 1e308], "nan",
)  # fmt: skip
"""Values that fields do not expect, of every JSON type and at the limits of numbers."""
WORDS = (
    b"NaN",
    b"Infinity",
    b"-Infinity",
    b"1e999",
    b"[" * 3000,
    b'{"a":' * 500,
    b"\xff",
    b"\x00",
    b",",
    b"null",
    b'"',
)
"""Byte strings that are inserted into a text to damage it."""


@dataclass
class Tally:
    """Counts of a fuzzing campaign: inputs accepted and refused, time of the slowest, and findings."""

    inputs: int = 0
    taken: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    findings: list[str] = field(default_factory=list[str])


class Drawer:
    """Generator of random values for a JSON Schema: most fit, some numbers lie at their limits or 1 beyond."""

    def __init__(self, schema: dict[str, Any], random: Random) -> None:
        self._root, self._random = schema, random

    def value(self, schema: dict[str, Any] | None = None, depth: int = 0) -> Any:
        """Return a random value that fits a JSON Schema (None: the drawer's own), sometimes one at its limits."""
        schema, random = self._root if schema is None else schema, self._random
        if "$ref" in schema:
            return self.value(self._root["$defs"][schema["$ref"].rpartition("/")[2]], depth + 1)
        for key in ("anyOf", "oneOf", "allOf"):
            if key in schema:
                return self.value(random.choice(schema[key]), depth + 1)
        if "const" in schema or "enum" in schema:
            return random.choice(schema.get("enum", [schema.get("const")]))
        match schema.get("type"):
            case "object":
                return self._object(schema, depth)
            case "array":
                return self._array(schema, depth)
            case "string":
                longest = min(schema.get("maxLength", 20), 20)
                return "".join(
                    random.choice("abz/_0 é") for _ in range(random.randint(schema.get("minLength", 0), longest))
                )
            case "boolean":
                return random.random() < 0.5
            case "integer":
                return self._number(schema, whole=True)
            case "number":
                return self._number(schema, whole=False)
            case _:
                return None

    def _object(self, schema: dict[str, Any], depth: int) -> dict[str, Any]:
        fields, needed = schema.get("properties", {}), set(schema.get("required", ()))
        found = {n: self.value(s, depth + 1) for n, s in fields.items() if n in needed or self._random.random() < 0.7}
        if not fields and isinstance(schema.get("additionalProperties"), dict):
            found = {
                f"k{n}": self.value(schema["additionalProperties"], depth + 1)
                for n in range(self._random.randint(0, 3))
            }
        return found

    def _array(self, schema: dict[str, Any], depth: int) -> list[Any]:
        if "prefixItems" in schema:
            values = [self.value(item, depth + 1) for item in schema["prefixItems"]]
            length = math.hypot(*values) if len(values) == 4 and self._random.random() < 0.9 else 0.0
            return [each / length for each in values] if length > 0.0 else values  # a quaternion
        low = schema.get("minItems", 0)
        count = self._random.randint(low, max(low, min(schema.get("maxItems", 4), low + 4)))
        return [self.value(schema.get("items", {}), depth + 1) for _ in range(count)]

    def _number(self, schema: dict[str, Any], *, whole: bool) -> float:
        random = self._random
        low = schema.get("minimum", schema.get("exclusiveMinimum", -10))
        high = schema.get("maximum", schema.get("exclusiveMaximum", low + 20))
        if random.random() < 0.1:
            return random.choice((low, high, low - 1, high + 1))
        return (
            random.randint(math.ceil(low), max(math.ceil(low), math.floor(high)))
            if whole
            else random.uniform(low, high)
        )


def damage(value: Any, random: Random) -> Any:
    """Return a JSON value with one part of it changed."""
    if isinstance(value, dict) and value and random.random() < 0.9:
        name = random.choice([*value])
        match random.randrange(4):
            case 0:
                return {key: part for key, part in value.items() if key != name}
            case 1:
                return {**value, random.choice(("x", "source", "epoch", name + "_")): random.choice(ODD)}
            case _:
                return {**value, name: damage(value[name], random)}
    if isinstance(value, list) and value and random.random() < 0.8:
        place = random.randrange(len(value))
        match random.randrange(4):
            case 0:
                return value[:place] + value[place + 1 :]
            case 1:
                return value * random.choice((2, 50))
            case _:
                return [*value[:place], damage(value[place], random), *value[place + 1 :]]
    return random.choice(ODD)


def spoil(data: bytes, random: Random) -> bytes:
    """Return bytes of which one is changed, or a piece is inserted, doubled or cut off."""
    place, end = sorted((random.randint(0, len(data)), random.randint(0, len(data))))
    match random.randrange(5):
        case 0:
            return data[:place]
        case 1:
            return data[:place] + random.choice(WORDS) + data[place:]
        case 2:
            return data[:place] + data[place:end] * 2 + data[end:]
        case 3:
            return data[:place] + data[end:]
        case _:
            return data[:place] + bytes((random.randrange(256),)) + data[place + 1 :]


def drawn(drawer: Drawer, random: Random) -> bytes:
    """Return the JSON text of a value of a schema, whole or damaged."""
    value = drawer.value()
    for _ in range(random.choice((0, 1, 1, 2))):
        value = damage(value, random)
    data = json.dumps(value, ensure_ascii=random.random() < 0.5).encode("utf-8", "surrogatepass")
    return spoil(data, random) if random.random() < 0.3 else data


def attempt(tally: Tally, what: str, data: bytes, read: Callable[[], object], slow_s: float = SLOW_S) -> None:
    """Count one input; an exception that is no typed error, or a time above `slow_s`, is a finding."""
    tally.inputs += 1
    began = time.thread_time()
    try:
        read()
        tally.taken += 1
    except SurefootError as error:
        tally.refused += 1
        if not str(error) or "\n" in str(error).strip() or "Traceback" in str(error):
            tally.findings.append(f"{what}: no sentence {str(error)[:120]!r} for {data[:200]!r}")
    except Exception as error:
        tally.findings.append(f"{what}: {type(error).__name__}: {str(error)[:120]} for {data[:200]!r}")
    took = time.thread_time() - began
    tally.slowest_s = max(tally.slowest_s, took)
    if took > slow_s:
        tally.findings.append(f"{what}: takes {took:.2f} s for {data[:200]!r}")
