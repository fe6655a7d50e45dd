"""Raw arrays of the size that their header states, with odd numbers in them, and the parts of services that read them.

A decoder checks the header and the size of an array only: what the numbers do is seen by whoever computes with them.
"""

from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz_inputs import Tally, attempt
from surefoot.bus.codec import decode, encode
from surefoot.errors import Refusal, SurefootError
from surefoot.geometry.heightmap import HeightMapError
from surefoot.schemas.terrain import ElevationMap, HeightMapMessage, LandmarkMap
from surefoot.schemas.whatif import BatchRequest
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.rehearsal import made_up_requests
from surefoot.services.footholds.service import Footholds
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.maps import Maps
from surefoot.services.stability.answers import batch_reply
from surefoot.services.walker.messages import heights_of

ODD = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, -1e-38, 3.4e38, -3.4e38, 1e300, -1e300, 1e9, -1.0)
"""Numbers that a float32 or float64 may hold and that a sender may fail to exclude."""
SIZES = (1e-300, 1e-9, 1e-4, 0.02, 0.05, 1.0, 1e6, 1e300)
"""Values for the edge of a cell of a map, m."""


def numbers(random: Random, count: int) -> NDArray[np.float64]:
    """Return `count` numbers, (count,), no unit, of which none, some or all are odd; at times any bits at all."""
    draw = np.random.default_rng(random.getrandbits(32))
    if random.random() < 0.1:
        return draw.integers(0, 2**64, count, dtype=np.uint64).view(np.float64)
    found = draw.normal(0.0, random.choice((0.0, 0.02, 1.0, 1e6)), count)
    return np.where(draw.random(count) < random.choice((0.0, 0.01, 0.3, 1.0)), draw.choice(ODD, count), found)


def _floats(random: Random, count: int) -> bytes:
    with np.errstate(over="ignore", invalid="ignore"):
        return numbers(random, count).astype("<f4").tobytes()


def _grid(random: Random) -> dict[str, Any]:
    cell = random.choice(SIZES) if random.random() < 0.2 else 0.02
    rows, cols = (random.choice((1, 2, 3, 40, random.randint(1, 90))) for _ in range(2))
    where = random.choice(((-0.02 * cols / 2, -0.02 * rows / 2), (0.0, 0.0), (1e300, -1e300), (1e9, 0.0)))
    return {"rows": rows, "cols": cols, "cell": cell, "origin": where, "version": random.randint(0, 3)}


def height_map(random: Random) -> HeightMapMessage:
    """Return a height map message whose array may hold odd numbers."""
    grid = _grid(random)
    return HeightMapMessage(**grid, data=_floats(random, grid["rows"] * grid["cols"]))


def own_map(random: Random) -> ElevationMap:
    """Return a message of a map that the robot measured, whose arrays may hold odd numbers."""
    grid = _grid(random)
    count = grid["rows"] * grid["cols"]
    layers = [b64encode(_floats(random, count)).decode() for _ in range(2)]
    if random.random() < 0.5:
        sure = np.abs(np.frombuffer(_floats(random, count), dtype="<f4")).tobytes()
        layers[1] = b64encode(sure).decode()
    return ElevationMap(**grid, heights=layers[0], variances=layers[1])


def landmarks(random: Random) -> LandmarkMap:
    """Return a message of a landmark map whose array may hold odd numbers."""
    count, length = random.choice((0, 1, 2, 50)), random.choice((0, 1, 8, 256))
    return LandmarkMap(count=count, descriptor_length=length, data=_floats(random, count * (2 + length)))


def sets(random: Random) -> BatchRequest:
    """Return a batch request of contact sets as raw numbers, which may be odd."""
    counts = tuple(random.randint(0, 6) for _ in range(random.randint(1, 4)))
    found = numbers(random, 2 * len(counts) + 7 * sum(counts))
    if random.random() < 0.5:  # as a robot stands, then a few numbers of it odd
        contact = np.resize([0.1, -0.1, 0.0, 0.0, 0.0, 1.0, 0.5], 7 * sum(counts))
        contact += np.random.default_rng(random.getrandbits(32)).normal(0.0, 1e-2, contact.size)
        keep = np.isfinite(found[2 * len(counts) :]) & (random.random() < 0.9)
        found[2 * len(counts) :] = np.where(keep, contact, found[2 * len(counts) :])
    return BatchRequest(counts=counts, data=found.astype("<f8").tobytes())


class Readers:
    """Parts of the services of a hexapod and a biped that read arrays."""

    def __init__(self) -> None:
        self.footholds = Footholds(FootholdsConfig(robot="ragno"))
        self.footholds.on_start()
        self.footholds.log = self.footholds.models.log = lambda level, text: None
        self.selects, self.assesses = made_up_requests(self.footholds.robot)

    def ground(self, message: HeightMapMessage | ElevationMap) -> None:
        """Prepare a map for footholds and for the walker, then choose footholds on it."""
        with suppress(HeightMapError):  # the walker goes on without
            heights_of(message).height_at(0.0, 0.0)
        self.footholds.latched.take(message)
        self.footholds.models.fit(self.footholds.latched.ground)
        for select in self.selects:
            with suppress(Refusal):
                self._finite(self.footholds.select(select))
        for assess in self.assesses:
            with suppress(Refusal):
                reply = self.footholds.assess(assess)
                decode(type(reply), *encode(reply))

    def floor(self, heights: HeightMapMessage | None, marks: LandmarkMap | None) -> None:
        """Prepare maps for the navigator and plan a route on them."""
        maps = Maps(NavigatorConfig(robot="nao"))
        problems = maps.take(heights, marks)
        with suppress(Refusal):
            maps.ways((0.0, 0.0), ((0.4, 0.1),))
        encode(maps.message())
        if problems:
            raise Refusal("refused", problems[0])

    def stability(self, request: BatchRequest) -> None:
        """Answer a batch request as the stability service does."""
        self._finite(batch_reply(request))

    @staticmethod
    def _finite(reply: Any) -> None:
        if decode(type(reply), *encode(reply)) != reply:
            raise AssertionError("a reply that is another after a second reading")


def odd_bodies(count: int, seed: int) -> dict[str, Tally]:
    """Pass its share of arrays to each reader; return the counts of outcomes by kind of array."""
    random, readers = Random(f"{seed} bodies"), Readers()
    kinds: dict[str, tuple[Callable[[Random], Any], Callable[[Any], None]]] = {
        "map for footholds": (height_map, readers.ground),
        "own map for footholds": (own_map, readers.ground),
        "map for the navigator": (height_map, lambda message: readers.floor(message, None)),
        "landmarks": (landmarks, lambda message: readers.floor(None, message)),
        "batch of contacts": (sets, readers.stability),
    }
    tallies = {kind: Tally() for kind in kinds}
    for kind, (draw, read) in kinds.items():
        for seed_of_first in range(3):  # compiles kernels: the time of an input is counted
            with suppress(SurefootError):
                read(draw(Random(seed_of_first)))
        for _ in range(max(1, count // len(kinds))):
            message = draw(random)
            payload, attachment = encode(message)
            again = decode(type(message), payload, attachment)
            data = (attachment or b"") + b" | " + payload[:200]
            attempt(tallies[kind], kind, data, lambda read=read, again=again: read(again), slow_s=2.0)
    return tallies
