"""Repetition of a recorded run from its metadata, unchanged or with changes from a control tick on."""

import json
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from surefoot.bus.codec import refusal_of
from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.lockstep.local import LocalSystem
from surefoot.nearest import did_you_mean
from surefoot.record.recording import HASHES, SUMMARY, ReadableRecording, open_readable, recording_info, topic_of
from surefoot.record.runhash import RunHash
from surefoot.schemas.footholds import SelectReply
from surefoot.schemas.sim import FAULT_FIELDS, FaultRequest, PushRequest, SetRequest
from surefoot.schemas.topics import FOOTHOLDS_SELECT, HW_TICK, TICK_S, Kind
from surefoot.services.supervisor.scenarios.recorded import RUN, present_versions, recorded_scenario
from surefoot.services.supervisor.scenarios.scenario import Scenario, Step

from ..runs.local import run_local
from .bisect import FirstDifference, first_difference
from .robots import attached_robot
from .sensors import RecordedLog
from .versions import recorded_versions

WORLD = ("friction", "mass", "servo")
"""Quantities of the simulated world that `whatif` can change: friction coefficient, factors on mass and servo gain."""
FOOT, PUSH, FAULT = "foot", "push", "fault"
RANGES = {
    "friction": (0.0, 10.0, ""), "mass": (0.0, 100.0, ""), "servo": (0.0, 100.0, ""), PUSH: (-1e6, 1e6, " N"),
    FAULT: (0.0, 3600.0, " s"), FOOT: (-0.2, 0.2, " m"),
}  # fmt: skip
"""Lowest and highest value of each change that `whatif` makes, with its unit; 0 itself is not allowed where it is the
lowest. A push is also held against the weight of the robot when it begins."""
PUSH_S = 0.2
"""Duration of a push that `whatif` applies, s."""
FORMS = "friction=.6, mass=1.2, servo=.8, push=y:20 (N), fault=imu_drop:2 (s), foot=lf:+.02 (m)"
"""Examples of the option `whatif --set`, one of each form, shown in errors."""


@dataclass(frozen=True)
class RecordedRun:
    """Metadata of a recorded run that a repetition needs.

    Attributes:
        recording: readable part of the file.
        scenario: scenario as it was run, with actuation delay and robot.
        seed: seed of the run.
        run_hash: recorded hash of the run; empty = the file was cut off before it.
        hashes: recorded digest of the messages of each topic, by key.
        robot_hash: hash of the robot description; empty = not recorded.
        versions: versions of the software that computed the run, by name.
        ticks: number of control ticks of the run.
        files: content of the files attached to the recording, on which the run depended, by name.
    """

    recording: ReadableRecording
    scenario: Scenario
    seed: int
    run_hash: str
    hashes: dict[str, str]
    robot_hash: str
    versions: dict[str, str]
    ticks: int
    files: dict[str, bytes] = field(default_factory=dict[str, bytes], repr=False)

    @classmethod
    def of(cls, path: Path) -> "RecordedRun":
        """Return the metadata of the run in a recording.

        Raises:
            SurefootError: the recording cannot be read or has no scenario, or the run was paced or kills a service.
        """
        recording = open_readable(path)
        metadata = recording.metadata
        run, summary = metadata.get(RUN, {}), metadata.get(SUMMARY, {})
        scenario = recorded_scenario(metadata, path)
        if run.get("mode") != "lockstep":
            got = run.get("mode", "unknown")
            raise SurefootError("invalid", f"{path}: mode is {got!r}; only runs in lockstep repeat", "mode")
        if any(step.do == "kill" for step in scenario.steps):
            raise SurefootError("invalid", f"{path}: its scenario ends a service; such a run does not repeat", "step")
        delay = int(run.get("actuation_delay_ticks", scenario.actuation_delay_ticks))
        scenario = replace(scenario, actuation_delay_ticks=delay, robot=run.get("robot", scenario.robot))
        last = min(scenario.max_ticks - 1, int(recording.end_ns * 1e-9 / TICK_S))
        return cls(
            recording, scenario, int(run["seed"]), summary.get("run_hash", ""),
            metadata.get(HASHES, {}), run.get("robot_hash", ""), recorded_versions(metadata),
            int(summary.get("last_tick", last)) + 1, recording.found.attachments,
        )  # fmt: skip

    def again(
        self,
        to: Path,
        meddle: Callable[[LocalSystem], None] = lambda system: None,
        progress: Callable[[float], None] = lambda share: None,
    ) -> str:
        """Repeat the run, write it to another recording, and return the hash of the repetition.

        Args:
            to: recording to write.
            meddle: called with the system before the run begins.
            progress: called with the share that is done, 0 to 1.

        Raises:
            SurefootError: the robot is not known here or has changed since, and the recording has no copy of it.
        """
        with tempfile.TemporaryDirectory() as folder:
            scenario = self._with_files(Path(folder))

            def prepare(system: LocalSystem) -> None:
                meddle(system)
                system.bus.subscribe(HW_TICK, lambda delivery: progress(delivery.header().tick / self.ticks))

            return run_local(scenario, self.seed, recording=to, meddle=prepare).run_hash

    def _with_files(self, folder: Path) -> Scenario:
        """Return the scenario with the recorded copies in place of files that are missing or have changed since."""
        scenario, recorded = self.scenario, self.scenario.robot or ""
        robot = attached_robot(self.recording, recorded, self.robot_hash, folder)
        if robot != recorded:
            scenario = replace(scenario, robot=robot)
        config = {service: dict(fields) for service, fields in scenario.config.items()}
        for service, fields in config.items():
            for name, value in fields.items():
                path = Path(str(value))
                content = self.files.get(f"{service}.{name}{path.suffix}")
                if content is not None and not _holds(path, content):
                    own = folder / f"{len(list(folder.iterdir()))}{path.suffix}"  # no name that a recording states
                    own.write_bytes(content)
                    fields[name] = str(own)
        return replace(scenario, config=config)


def _holds(path: Path, content: bytes) -> bool:
    """Return True if a file exists with exactly this content, else False."""
    try:
        return path.read_bytes() == content
    except OSError:
        return False


@dataclass(frozen=True)
class Verification:
    """Result of the repetition of a recorded run.

    Attributes:
        recorded, repeated: hash of the recorded and of the repeated run.
        keys: keys of topics whose digests differ.
        first: first difference of the messages; None = there is none.
        versions: recorded and present version of software that has changed since, by name.
        altered: keys of topics whose messages in the file are not those that were recorded.
        damage: reason why a part of the recording cannot be read; empty = all of it can be read.
        compared_s: simulated time up to which messages were compared, s; None = hashes were compared instead.
    """

    recorded: str
    repeated: str
    keys: tuple[str, ...]
    first: FirstDifference | None
    versions: dict[str, tuple[str, str]]
    altered: tuple[str, ...] = ()
    damage: str = ""
    compared_s: float | None = None

    @property
    def repeats(self) -> bool:
        """True if the repetition has the recorded hash or, if that is lost, equal readable messages; else False."""
        if not self.recorded:
            return bool(self.damage) and self.first is None
        return self.recorded == self.repeated

    @property
    def same(self) -> bool:
        """True if the repetition has the recorded hash, and the file holds all its messages unaltered; else False."""
        return bool(self.recorded) and self.recorded == self.repeated and not self.altered and not self.damage


@contextmanager
def kept(out: Path | None) -> Generator[Path]:
    """Yield the path to which a repetition is written: it is moved to `out` at the end, or deleted if `out` is None."""
    if out is not None:
        with whole(out) as part:
            yield part
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "again.mcap"


def verify(
    run: RecordedRun | RecordedLog, keep: Path | None = None, progress: Callable[[float], None] = lambda share: None
) -> Verification:
    """Repeat a run from its recording alone, and return the comparison with it.

    Args:
        run: recorded run in lockstep, or recording without a scenario, of which what follows from its sensor messages
            is repeated.
        keep: recording of the repetition to keep; None = it is deleted.
        progress: called with the share that is done, 0 to 1.

    Raises:
        SurefootError: the robot is not known here or has changed since, and the recording has no copy of it.
    """
    altered = () if run.recording.damage else _altered(run)
    with kept(keep) as target:
        found, keys = run.again(target, progress=progress), None
        metadata = recording_info(target)["metadata"]
        now, digests = recorded_versions(metadata), metadata.get(HASHES, {})
        if isinstance(run, RecordedLog):
            keys, now = run.compared, {**now, **present_versions()}
        changed = {n: (v, now.get(n, "absent")) for n, v in run.versions.items() if now.get(n) != v}
        if run.recording.damage:
            last = max(piece.end_ns for piece in run.recording.gapless)
            first = first_difference(run.recording, target, keys=keys)
            return Verification(run.run_hash, found, (), first, changed, (), run.recording.damage, last * 1e-9)
        if found and found == run.run_hash:
            return Verification(run.run_hash, found, (), None, changed, altered)
        differ = sorted(k for k in keys or {*run.hashes, *digests} if run.hashes.get(k) != digests.get(k))
        first = first_difference(run.recording, target, keys=keys)
        return Verification(run.run_hash, found, tuple(differ), first, changed, altered)


def _altered(run: RecordedRun | RecordedLog) -> tuple[str, ...]:
    """Return the keys whose messages in the file have another digest than the recorded one."""
    found = RunHash()
    for item in run.recording.messages(tuple(run.hashes) or ("",)):
        raw = item.raw()
        try:
            head = json.loads(raw.attachment or raw.payload)
            stamp_ns = head["stamp_ns"] if _joined(item.key) else 0
            found.update(item.key, head["epoch"], stamp_ns, head["seq"], raw.payload, raw.attachment)
        except (ValueError, KeyError, TypeError):
            found.update(item.key, 0, 0, 0, raw.payload, None)
    digests = found.keys()
    return tuple(sorted(key for key, digest in run.hashes.items() if digests.get(key) != digest))


def _joined(key: str) -> bool:
    """Return True if messages of a key are recorded tick by tick, with their stamps in the digest; else False."""
    topic = topic_of(key)
    return topic is not None and topic.kind not in (Kind.LATCHED, Kind.STATUS)


def _not_allowed(why: str) -> SurefootError:
    """Return the error for a change that is not allowed, with the reason `why` and the allowed forms."""
    return SurefootError("invalid", f"{why}; allowed are {FORMS}", "set")


@dataclass(frozen=True)
class Change:
    """Change of a run in its repetition, from a text like `friction=.6` or `foot=lf:+.02`.

    Attributes:
        name: quantity of the simulated world, `push`, `fault` or `foot`.
        value: coefficient or factor of a quantity, duration of a fault, s, force of a push, N, or shift of a foot, m.
        target: leg of a foot, kind of a fault, axis of a push (x or y).
    """

    name: str
    value: float
    target: str = ""

    @classmethod
    def of(cls, text: str) -> "Change":
        """Parse the text of a change (raises SurefootError with the allowed forms)."""
        name, sign, rest = text.partition("=")
        target, colon, number = rest.rpartition(":")
        known = (name in WORLD and not colon) or (name in (FOOT, PUSH, FAULT) and bool(target))
        try:
            value = float(number)
        except ValueError:
            known, value = False, 0.0
        if name not in RANGES:
            raise _not_allowed(f"--set {text!r}: got {name!r}{did_you_mean(name, RANGES)}")
        if not sign or not known:
            raise _not_allowed(f"--set {text!r} is no such form")
        if name == PUSH and target not in ("x", "y"):
            raise _not_allowed(f"--set {text!r}: the axis is x or y")
        if name == FAULT and target not in FAULT_FIELDS:
            raise _not_allowed(f"--set {text!r}: got fault {target!r}{did_you_mean(target, FAULT_FIELDS)}")
        low, high, unit = RANGES[name]
        if not (low < value <= high if low == 0.0 else low <= value <= high):
            least = "above 0" if low == 0.0 else f"{low:g}"
            raise _not_allowed(f"--set {text!r}: got {value:g}, allowed is {least} to {high:g}{unit}")
        change = cls(name, value, target)
        try:
            change.step(0)
        except ValidationError as error:
            raise _not_allowed(refusal_of(error, f"--set {text!r}").message) from None
        return change

    def step(self, tick: int) -> Step | None:
        """Return the scenario step that makes the change at a control tick; None for a shift of a foot."""
        if self.name in WORLD:
            return Step("set", at_tick=tick, request=SetRequest(quantity=self.name, value=self.value))  # type: ignore[arg-type]
        if self.name == PUSH:
            force = (self.value, 0.0, 0.0) if self.target == "x" else (0.0, self.value, 0.0)
            return Step("push", at_tick=tick, request=PushRequest(force=force, duration=PUSH_S))
        if self.name == FAULT:
            fields: dict[str, Any] = {"kind": self.target, "duration": self.value}
            return Step("fault", at_tick=tick, request=FaultRequest(**fields))
        return None


def changed(
    run: RecordedRun,
    at_s: float,
    changes: Sequence[Change],
    to: Path,
    progress: Callable[[float], None] = lambda share: None,
) -> str:
    """Repeat a run with changes from a time on; return the hash, which without changes is the recorded one.

    Args:
        run: recorded run in lockstep.
        at_s: simulated time from which on the changes hold, s.
        changes: changes of world, forces, faults and footholds.
        to: recording to write.
        progress: called with the share that is done, 0 to 1.

    Raises:
        SurefootError: the time is outside of the run, or the robot has no such leg or no foothold service.
    """
    tick = round(at_s / TICK_S)
    if not 0 <= tick < run.ticks:
        raise SurefootError("invalid", f"--at {at_s:g}: allowed is 0 to {run.ticks * TICK_S:g} s", "at")
    steps = tuple(step for change in changes if (step := change.step(tick)) is not None)
    feet = {change.target: change.value for change in changes if change.name == FOOT}
    again = replace(run, scenario=replace(run.scenario, steps=(*run.scenario.steps, *steps)))
    return again.again(to, lambda system: _shift(system, feet, tick) if feet else None, progress)


def _shift(system: LocalSystem, feet: dict[str, float], tick: int) -> None:
    """Shift the chosen footholds of legs along x of the map from a tick on; `feet`: shift by leg name, m."""
    service: Any = next((node.service for node in system.nodes if node.name == "footholds"), None)
    if service is None:
        raise SurefootError("invalid", "--set foot: this system has no service `footholds`", "set")
    for leg in feet:
        if leg not in service.robot.leg_names:
            raise _not_allowed(f"--set foot={leg}: legs are {', '.join(service.robot.leg_names)}")

    def select(request: Any) -> SelectReply:
        reply = service.select(request)
        if (request.tick if request.tick is not None else service.tick) < tick:
            return reply
        return reply.model_copy(update={"legs": tuple(_moved(leg, feet.get(leg.leg, 0.0)) for leg in reply.legs)})

    service.handle(FOOTHOLDS_SELECT, select)


def _moved(leg: Any, by: float) -> Any:
    if leg.foothold is None or not by:
        return leg
    x, y, z = leg.foothold
    return leg.model_copy(update={"foothold": (x + by, y, z)})
