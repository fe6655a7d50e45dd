"""Report of a recording, which may lack the truth, be cut off, or be of an unknown robot."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from surefoot.errors import SurefootError
from surefoot.record.recording import SUMMARY, ReadableRecording, open_readable
from surefoot.record.robots import robot_of
from surefoot.robot.description import RobotError
from surefoot.services.supervisor.scenarios.recorded import SCENARIO, VERSIONS, recorded_scenario
from surefoot.services.supervisor.scenarios.scenario import Scenario

from ..scene.film import Film, film_of_recording
from .judge import RunVerdict, judge
from .page import About, write_report
from .traces import KEYS, read_traces
from .why import explain

READ, EXPLAINED, FILMED = 0.3, 0.5, 0.8
"""`READ`: progress of a report, 0 to 1, once the recording is read; `EXPLAINED`: once the failure is explained;
`FILMED`: once the replay is made."""
HASH_SHOWN = 12
"""Length of the part of a configuration's hash that a report shows, characters."""
UNFINISHED = "the run lasted until max_duration_s: its steps may be unfinished"


def report_recording(
    file: Path, scenario: Scenario | None, out: Path, progress: Callable[[float], None] = lambda share: None
) -> tuple[Path, RunVerdict]:
    """Write the report of a recording; return its path and the verdict.

    Args:
        file: MCAP file.
        scenario: whose limits hold; None = those of the recording.
        out: HTML file.
        progress: gets the share that is done.

    Raises:
        SurefootError: nothing of the file can be read, or it holds no message of a run.
    """
    recording = open_readable(file)
    run, summary = recording.metadata.get("run", {}), recording.metadata.get(SUMMARY, {})
    traces = read_traces(recording.messages((*KEYS, "terrain/map"), lambda share: progress(READ * share)))
    if not traces.rows:
        raise SurefootError("invalid", f"{file} has none of {', '.join(KEYS)} that can be read", "recording")
    why, partly = explained(recording, whole=not recording.damage)
    partly |= traces.refused
    notes = (*recording.notes, *filter(None, (why,)))
    progress(EXPLAINED)
    if SCENARIO in recording.metadata:
        own = recorded_scenario(recording.metadata, file)
        scenario = own if scenario is None else scenario
        notes += (UNFINISHED,) if own.steps and traces.last_tick + 1 >= own.max_ticks else ()
    limits = {} if scenario is None else scenario.limits
    hashed = summary.get("run_hash", "")
    verdict = judge(traces, limits, message_hash=hashed, notes=notes, watched=False)
    verdict = replace(verdict.of_a_part() if partly or recording.damage else verdict, why=why)
    about = About(
        scenario=file.stem if scenario is None else scenario.name,
        description=str(file) if scenario is None else scenario.description,
        seed=_seed(run),
        facts={"Recording": str(file), **_recorded_facts(recording, scenario)},
        limits=limits,
    )
    about, film = filmed(recording, about)
    verdict = replace(verdict, notes=(*verdict.notes, *(() if film is None else film.notes)))
    progress(FILMED)
    return write_report(out, about, traces, verdict, film), verdict


def filmed(recording: ReadableRecording, about: About) -> tuple[About, Film | None]:
    """Return `about` with the names of the legs, and the film for the replay; None where the robot is unknown."""
    try:
        robot = robot_of(recording)
    except (SurefootError, RobotError) as error:
        return replace(about, no_film=f"the robot is not known here: {error}"), None
    film = film_of_recording(recording, robot)
    return replace(about, feet=robot.leg_names, no_film="; ".join(film.notes)), film


def explained(file: Path | ReadableRecording, *, whole: bool = False) -> tuple[str, bool]:
    """Explain a recorded run: why it went wrong, which messages cannot be read, where its clock jumps.

    Returns:
        One sentence, empty where nothing of this is the case; and whether messages are unreadable or the clock jumps.

    Args:
        file: MCAP file, or the opened recording.
        whole: the file is whole: messages in it that cannot be read are reported here.
    """
    try:
        found = explain(file)
    except SurefootError:
        return "", True
    partly = bool(found.jumps or found.damage)
    bad = found.outcome is not None or bool(found.jumps) or (whole and bool(found.damage))
    return found.sentence if bad else "", partly


def _recorded_facts(recording: ReadableRecording, scenario: Scenario | None) -> dict[str, str]:
    """Return the facts of a run that its recording states: its names, the versions and the configuration set for it."""
    run, versions = recording.metadata.get("run", {}), recording.metadata.get(VERSIONS, {})
    summary = recording.metadata.get(SUMMARY, {})
    config = {} if scenario is None else scenario.config
    variables = [f"{service}.{name} = {value}" for service, fields in config.items() for name, value in fields.items()]
    facts = {
        **{name.replace("_", " ").capitalize(): value for name, value in run.items()},
        "Versions": ", ".join(f"{name} {value}" for name, value in versions.items()),
        "Configuration": ", ".join(variables),
        "Hashes of the configuration": _hashes(summary.get("configuration", "")),
        "Wall time": f"{summary['wall_s']} s from the first to the last tick" if "wall_s" in summary else "",
    }
    stated = {**facts, "Message hash": summary.get("run_hash", "")}
    missing = [
        name.lower() for name in ("Wall time", "Hashes of the configuration", "Message hash") if not stated[name]
    ]
    why = "it has no summary, which is written at the end of a run" if not summary else "its summary has none"
    facts["Not stated by the recording"] = f"{', '.join(missing)}: {why}" if missing else ""
    return {name: value for name, value in facts.items() if value}


def _hashes(text: str) -> str:
    """Return the hash of each service's configuration as the recorder states them, shortened; empty: not stated."""
    try:
        found = json.loads(text)
    except ValueError:
        return ""
    stated = found.items() if isinstance(found, dict) else ()
    return ", ".join(f"{name} {str(value)[:HASH_SHOWN]}" for name, value in stated if value)


def _seed(run: dict[str, str]) -> int:
    text = run.get("seed", "")
    return int(text) if text.isdecimal() else 0
