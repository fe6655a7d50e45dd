"""Slip models and policies with something wrong in them, and whether one that is taken still decides well.

A file is changed along its structure: a field left out, doubled or of another type, numbers scaled, negated, mixed
up, beyond their limits. One that is taken must choose no worse than without it: footholds by the slip that the sound
model predicts, beside nominal landings; policies by the time to the goal, beside the rule `hand`.
"""

import io
import json
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fuzz_inputs import Tally, attempt, damage
from surefoot.geometry.heightmap import HeightMap
from surefoot.lab.train.evaluation import Seeds, episodes
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.footholds import AssessRequest, BasePose, LegRequest, ModelRequest, SelectRequest
from surefoot.schemas.hw import Tick
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import TERRAIN_MAP
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.models.files import shipped as shipped_model
from surefoot.services.footholds.service import Footholds
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.files import shipped as shipped_policies
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load
from surefoot.services.simulator.ground.terrain import make_terrain

POLICIES = {"planner-nao-four": ("nao", ()), "planner-nao-arcs": ("nao", ("use='arcs'",)), "sarsa-paper": ("paper", ())}
"""Shipped policies whose files are changed: name of the file to model and settings that it was made for."""
EPISODES = Seeds(30_000, 30_040)
EPISODES_S = 5.0
"""Largest processor time of a policy with its episodes, s: a planner of another model is computed anew."""
WORSE = 1.02
"""Largest ratio at which a decision counts as no worse: time over that of the rule, or slip over that of nominal
landings."""
STROKE = (-0.05, 0.0, 0.0)
PLACES = ((0.5, 0.0), (0.8, 0.2), (1.1, -0.2), (1.4, 0.1))
"""Positions (x, y) of the trunk on the ground, map frame, m."""
GROUNDS = (("rough", 0), ("rough", 1), ("mixed", 2))


def changed(value: Any, random: Random) -> Any:
    """Return a JSON value with one number, list or field of it changed."""
    if isinstance(value, dict) and value and random.random() < 0.95:
        name = random.choice([*value])
        return {**value, name: changed(value[name], random)} if random.random() < 0.9 else damage(value, random)
    if isinstance(value, list) and value:
        match random.randrange(8):
            case 0:
                return random.sample(value, len(value))
            case 1:
                return value[: random.randrange(len(value))]
            case 2 if all(isinstance(each, int | float) for each in value):
                factor = random.choice((-1, 0, 1000, 10**30, random.uniform(0.5, 2)))
                return [each * factor if abs(each) < 1e200 else each for each in value]
            case _:
                place = random.randrange(len(value))
                return [*value[:place], changed(value[place], random), *value[place + 1 :]]
    if isinstance(value, int | float) and not isinstance(value, bool) and random.random() < 0.8:
        near = value / 10 if abs(value) < 1e300 else 1e300
        return random.choice((-value, 0, value * 10, near, value + 1, 1e200 * near, random.gauss(0, 1)))
    return damage(value, random)


class SlipJudge:
    """Foothold service on known grounds, whose choices under a changed model are rated by the unchanged model."""

    def __init__(self) -> None:
        self.service = Footholds(FootholdsConfig(relearn="off"))
        self.system = LocalSystem([self.service])
        self.service.log = self.service.models.log = lambda level, text: None
        self.sound = shipped_model(self.service.robot.name)
        assert self.sound is not None
        self.content: dict[str, Any] = json.loads(self.sound.read_bytes())
        self.maps = [self._message(kind, seed, number) for number, (kind, seed) in enumerate(GROUNDS)]
        self.values = [[self._values(place, map_) for place in PLACES] for map_ in self.maps]
        self.nominal, self.best = self._slip(nominal=True), self._slip()

    def file(self, random: Random) -> bytes:
        """Return the content of the slip model file with one to four random changes."""
        content = self.content
        for _ in range(random.choice((1, 1, 2, 4))):
            content = changed(content, random)
        return json.dumps(content).encode()

    def use(self, path: Path) -> None:
        """Load a changed model file and choose footholds by it.

        Raises:
            SurefootError: the file is refused.
            AssertionError: it is taken, and its choices are worse than nominal landings.
        """
        self.service.use_model(ModelRequest(use=str(path)))
        slip = self._slip()
        if not slip <= WORSE * self.nominal:
            raise AssertionError(f"taken, but its choices slip {slip:.4f}, nominal landings {self.nominal:.4f}")

    def _message(self, kind: str, seed: int, number: int) -> HeightMapMessage:
        ground: HeightMap = make_terrain(kind, seed=seed, amp=0.04 if kind == "rough" else None).map
        return HeightMapMessage.model_validate({**ground.header(), "version": number + 1, "data": ground.to_bytes()})

    def _take(self, message: HeightMapMessage) -> None:
        self.service.on_tick(TickInputs(Tick.model_construct(tick=0, epoch=0), {TERRAIN_MAP.key: message}))

    def _request(self, place: tuple[float, float]) -> SelectRequest:
        robot, z = self.service.robot, 0.13
        feet = foot_positions(robot.model, robot.neutral) + np.array([*place, z])
        legs = tuple(
            LegRequest(leg=name, nominal=(float(p[0]), float(p[1]), 0.0), stroke=STROKE)
            for name, p in zip(robot.leg_names, feet, strict=True)
        )
        return SelectRequest(base=BasePose(position=(*place, z)), legs=legs)

    def _values(self, place: tuple[float, float], message: HeightMapMessage) -> list[NDArray[np.float32]]:
        """Return the slip per stroke that the unchanged model predicts in the window of each leg."""
        self._take(message)
        found = []
        for leg in self._request(place).legs:
            reply = self.service.assess(AssessRequest(centre=leg.nominal[:2], size=15, stroke=STROKE, layers=("p",)))
            found.append(np.frombuffer(reply.data, "<f4").reshape(15, 15))
        return found

    def _slip(self, *, nominal: bool = False) -> float:
        """Return the mean slip of the choices; a leg without the foothold that the unchanged model has counts as 1."""
        slips: list[float] = []
        for message, ground in zip(self.maps, self.values, strict=True):
            self._take(message)
            for place, windows in zip(PLACES, ground, strict=True):
                reply = self.service.select(self._request(place))
                for leg, window in zip(reply.legs, windows, strict=True):
                    if nominal or leg.offset is None:
                        slips.append(float(window[7, 7]) if nominal else 1.0)
                        continue
                    col, row = (round(each / message.cell) + 7 for each in leg.offset)
                    slips.append(float(window[min(14, max(0, row)), min(14, max(0, col))]))
        return float(np.nanmean(slips))


class PolicyJudge:
    """Policies of shipped files, and the time to the goal under a changed one beside that of the rule."""

    def __init__(self) -> None:
        self.worlds = {name: (model := load(params, sets), arrays(model)) for name, (params, sets) in POLICIES.items()}
        self.hand = {name: self._seconds(name, "hand") for name in POLICIES}
        self.held: dict[str, dict[str, Any]] = {}
        for name in POLICIES:
            with np.load(shipped_policies()[name], allow_pickle=False) as file:
                self.held[name] = {member: file[member] for member in file.files}

    def file(self, name: str, random: Random) -> bytes:
        """Return the content of the policy file of this name with one or two random changes."""
        held = dict(self.held[name])
        for _ in range(random.choice((1, 1, 2))):
            member = random.choice([*held])
            if random.random() < 0.08:
                held.pop(member)
            else:
                held[member] = _altered(member, held[member], random)
        buffer = io.BytesIO()
        np.savez(buffer, **held)
        return buffer.getvalue()

    def use(self, name: str, path: Path) -> None:
        """Load a changed policy file and run episodes by it.

        Raises:
            SurefootError: the file is refused.
            AssertionError: it is taken, and it is slower than the rule.
        """
        seconds = self._seconds(name, str(path))
        if not seconds <= WORSE * self.hand[name]:
            raise AssertionError(f"taken, but it needs {seconds:.0f} s, the rule {self.hand[name]:.0f} s")

    def _seconds(self, name: str, policy: str) -> float:
        model, world = self.worlds[name]
        return float(episodes(world, find(policy, model, world), EPISODES)["seconds"].mean())


def _altered(member: str, array: NDArray[Any], random: Random) -> NDArray[Any]:
    """Return a member array of a policy file with its words, type, shape or numbers changed."""
    if array.dtype.kind == "U":
        if member == "provenance":
            return np.array(json.dumps(changed(json.loads(str(array)), random)))
        words = array.reshape(-1).tolist()
        return np.array(random.choice((random.sample(words, len(words)), words[:-1], [*words, "x"], ["walk"])))
    if array.dtype.kind != "f":
        return np.array(random.choice((0, 2, -1, 1.5, "1", [1, 1])))
    if array.size == 0:
        return np.zeros(1)
    numbers = np.random.default_rng(random.getrandbits(32))
    match random.randrange(10):
        case 0:
            return array.astype(random.choice(("int64", "complex128", "str", "float16", "bool")))
        case 1:
            return random.choice((array.reshape(-1), array[..., :-1], array[None], array[:0], array.T))
        case 2 | 3:
            return array * random.choice((-1.0, 0.0, 1e3, 1e30, random.uniform(0.5, 2.0)))
        case 4:
            return numbers.permuted(array, axis=-1) if array.ndim else array
        case 5:
            return array + random.choice((0.01, 1.0, 100.0)) * numbers.standard_normal(array.shape)
        case 6:
            return np.flip(array, axis=random.randrange(array.ndim))
        case _:
            out = array.copy()
            out.reshape(-1)[random.randrange(out.size)] = random.choice((np.nan, np.inf, 1e30, -1e30, 0.0))
            return out


def judged(count: int, seed: int, folder: Path) -> Iterator[tuple[str, Tally, float]]:
    """Change and use `count` files of models and policies; yield the kind, the outcomes, and the processor time, s."""
    random, path = Random(f"{seed} models"), folder / "changed"
    slips, tally, began = SlipJudge(), Tally(), time.process_time()
    for _ in range(count):
        data = slips.file(random)
        path.write_bytes(data)
        attempt(tally, "slip model", data, lambda: slips.use(path))
    yield "slip models", tally, time.process_time() - began
    policies, tally, began, path = PolicyJudge(), Tally(), time.process_time(), folder / "changed.npz"
    for number in range(count):
        name = [*POLICIES][number % len(POLICIES)]
        with np.errstate(all="ignore"):
            data = policies.file(name, random)
        path.write_bytes(data)
        attempt(tally, f"policy {name}", data, lambda name=name: policies.use(name, path), EPISODES_S)
    yield "policies", tally, time.process_time() - began
