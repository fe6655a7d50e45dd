"""Commands `surefoot why|verify|whatif|bisect`: explain, repeat, change and compare recorded runs."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..cli.completion import beginning
from ..cli.output import EXIT_CHECK, Json, near, notify, refuse_existing, use_json, write, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from surefoot.services.supervisor.scenarios.scenario import Scenario

    from .bisect import FirstDifference
    from .repeat import Verification

app = typer.Typer()
Recording = Annotated[Path, typer.Argument(help="MCAP file of a run.")]
PACED = "it was no import: ticks that were left out or late, and a configured estimator, do not repeat to the bit"
"""Note on a run with its own clock whose estimates differ when they are computed again."""
Keep = Annotated[Path | None, typer.Option("--out", "-o", help="Keep the repetition as this MCAP file.")]


def _changes(incomplete: str) -> list[str]:
    """Return the names of changes for `whatif --set`, each with its `=`, that begin with `incomplete`."""
    from .repeat import FAULT, FOOT, PUSH, WORLD

    return beginning((f"{name}=" for name in (*WORLD, PUSH, FAULT, FOOT)), incomplete)


@app.command()
def why(file: Recording, json: Json = False) -> None:
    """Walk back from a fall, stop, halt, missed goal or slip to its first cause. Exit code 1: something went wrong,
    a part of the recording cannot be read, or its clock jumps."""
    use_json(json)
    with Progress(f"causes in {file.name}", reads=[file]) as progress:
        from surefoot.record.recording import recorded_by

        from ..report.why import explain

        found = explain(file, progress.at)
    if json:
        write_json({"sentence": found.sentence, **vars(found)})
    else:
        write(found.sentence)
        if found.version:
            write(f"note  {recorded_by(found.version)}")
        rows = [each for each in (found.cause, *found.chain, found.outcome) if each is not None]
        if rows:
            write_table(("time", "kind", "what was seen"), [(f"{e.begin:.2f} s", e.code, e.text) for e in rows])
    if found.outcome is not None or found.damage or found.jumps:
        raise typer.Exit(EXIT_CHECK)


@app.command()
def verify(
    file: Annotated[Path | None, typer.Argument(help="MCAP file of a run [the public list of hashes].")] = None,
    scenario: Annotated[list[str] | None, typer.Option(help="Runs of this scenario in the public list.")] = None,
    out: Keep = None,
    json: Json = False,
) -> None:
    """Repeat a run from its recording alone and compare every deterministic message. Exit code 1: it differs.

    The scenario, the seed and the delay come from the recording; the run takes place in this process. Of an imported
    log, or a robot's run without a scenario, the estimates are computed again from its sensor messages. Without a
    recording it repeats the runs of the public list (scenario, seed, hash): some minutes.
    """
    use_json(json)
    if file is None:
        if out is not None:
            raise typer.BadParameter("keeps the repetition of a recording", param_hint="--out")
        _verify_list(tuple(scenario or ()), json=json)
        return
    if scenario:
        raise typer.BadParameter("is of the public list, not of a recording", param_hint="--scenario")
    if out is not None:
        refuse_existing(out, force=False)
    with Progress(near(file), reads=[file]):
        notify(f"surefoot: repeating the run of {near(file)}")
        from surefoot.record.recording import open_readable

        from .repeat import RecordedRun
        from .repeat import verify as repeat
        from .sensors import RecordedLog, without_scenario

        recording = open_readable(file)
        run = RecordedLog.of(recording) if without_scenario(recording) else RecordedRun.of(file)
    if isinstance(run, RecordedRun):
        _warm(run.scenario)
    with Progress(near(file)) as progress:
        found = repeat(run, out, progress.at)
    if json:
        write_json({"same": found.same, **vars(found)})
    else:
        write(f"recorded  {found.recorded or 'the file was cut off before its hash'}\nrepeated  {found.repeated}")
        for name, (was, now) in found.versions.items():
            write(f"note      {name} {was} recorded, {now} here")
        if found.damage:
            write(f"note      only a part of the recording can be read: {found.damage}")
            _show(found.first)
            write(f"compared are its messages up to the first loss, at {found.compared_s:.2f} s")
        elif found.recorded != found.repeated:
            write(f"keys that differ: {', '.join(found.keys) or 'not recorded'}")
            _show(found.first)
        if isinstance(run, RecordedLog):
            write("note      no scenario: compared are the sensor messages, and what the services compute from them")
        if isinstance(run, RecordedLog) and not run.imported and not found.same:
            write(f"note      {PACED}")
        for line in _ending(found):
            write(line)
    if not found.same:
        raise typer.Exit(EXIT_CHECK)


def _ending(found: "Verification") -> Iterator[str]:
    """Yield sentences: which messages of the file were altered after the run, and if the run repeats."""
    from surefoot.record.recording import topic_of

    inputs = [key for key in found.altered if (topic := topic_of(key)) is not None and topic.owner == "driver"]
    outputs = [key for key in found.altered if key not in inputs]
    for kind, keys in (("inputs (of the driver)", inputs), ("outputs (of services)", outputs)):
        if keys:
            yield f"altered in the file since it was recorded, {kind}: {', '.join(keys)}"
    if found.altered and found.repeats:
        yield "the run repeats: its repetition has the recorded hash to the bit, the altered messages do not fit it"
        return
    part = "the part that can be compared" if found.damage and not found.recorded else "the run"
    yield f"{part} {'repeats to the bit' if found.repeats else 'does not repeat'}"


def _verify_list(names: tuple[str, ...], *, json: bool) -> None:
    """Repeat runs of the public list (scenarios `names`, all if empty) and show which have the listed hash."""
    from surefoot.services.supervisor.scenarios.scenario import load_scenario
    from surefoot.version import numbers

    from .public import NUMBERS, public_runs

    rows, runs = [], public_runs(names)
    every = sum(run.ticks for run in runs)
    for name in dict.fromkeys(run.scenario for run in runs):
        _warm(load_scenario(name))
    with Progress("list") as progress:
        for run in runs:
            progress.at(sum(run.ticks for run, _ in rows) / every, f"{run.scenario}, seed {run.seed}")
            rows.append((run, run.again()))
    same = sum(run == found for run, found in rows)
    if json:
        every_run = [{**a._asdict(), "found": b.run_hash, "found_ticks": b.ticks} for a, b in rows]
        write_json({"same": same == len(rows), "numbers": numbers(), "runs": every_run})
    else:
        shown = [(a.scenario, str(a.seed), a.run_hash[:12], "same" if a == b else b.run_hash[:12]) for a, b in rows]
        write_table(("scenario", "seed", "public hash", "here"), shown)
        write(f"{same} of {len(rows)} runs have the public hash")
        if numbers() != NUMBERS:
            write(f"note  the hashes are of {NUMBERS}; this is {numbers()}, where other last bits are to be expected")
    if same != len(rows):
        raise typer.Exit(EXIT_CHECK)


@app.command()
def bisect(a: Recording, b: Annotated[Path, typer.Argument(help="Another recording.")], json: Json = False) -> None:
    """Name the first message and field in which two recordings differ. Exit code 1: there is one, or a recording
    cannot be read to its end."""
    use_json(json)
    with Progress(f"comparison of {near(a)} and {near(b)}", reads=[a, b]) as progress:
        from surefoot.record.recording import open_readable

        from .bisect import first_difference

        opened = [open_readable(path) for path in (a, b)]
        found = first_difference(opened[0], opened[1], progress.at)
    damage = [each.damage for each in opened if each.damage]
    if json:
        write_json({"same": found is None and not damage, "first": found, "damage": damage})
    else:
        _show(found)
        for each in damage:
            write(f"note  compared up to the first loss: {each}")
    if found is not None or damage:
        raise typer.Exit(EXIT_CHECK)


@app.command()
def whatif(
    file: Recording,
    at: Annotated[float, typer.Option(min=0.0, help="Simulated time from which the changes hold, s.")] = 0.0,
    change: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="friction=.6, mass=1.2, servo=.8, push=y:20 (N), foot=lf:+.02 (m).",
            autocompletion=_changes,
        ),
    ] = None,
    out: Keep = None,
    json: Json = False,
) -> None:
    """Go on from a moment of a recorded run with something changed, in the same world, and compare both.

    Without a change the repetition has the recorded hash. The run is repeated from its beginning in this process.
    """
    from .compare import compare
    from .repeat import Change, RecordedRun, changed, kept

    use_json(json)
    changes = [Change.of(text) for text in change or ()]
    if out is not None:
        refuse_existing(out, force=False)
    run = RecordedRun.of(file)
    what = f"{', '.join(change)} from {at:g} s on" if change else "nothing changed"
    notify(f"surefoot: repeating the run of {near(file)}, {what}")
    _warm(run.scenario)
    with kept(out) as target, Progress(near(file)) as progress:
        found = changed(run, at, changes, target, progress.at)
        rows = compare(run.recording, target, at)
    for note in run.recording.notes:
        notify(f"note  {note}")
    if json:
        write_json({"same": found == run.run_hash, "run_hash": found, "rows": [row._asdict() for row in rows]})
        return
    write_table(("quantity", "recorded", "changed"), [(row.title, row.before, row.after) for row in rows])
    lost = "" if run.run_hash else ", the recorded one is not in the file"
    write(f"hash {found}{', as recorded' if found == run.run_hash else lost}")


def _show(found: "FirstDifference | None") -> None:
    write("no difference in any deterministic message" if found is None else found.sentence)


def _warm(scenario: "Scenario") -> None:
    """Compile the kernels of a scenario's system unless they are in the cache, with progress lines.

    For a robot that exists only in the recording nothing is done: its kernels are compiled during the run.
    """
    from surefoot.robot.description import RobotError
    from surefoot.services.supervisor.processes.startable import system_of

    from ..cli.warming import warm_if_cold

    with suppress(RobotError):
        warm_if_cold(system_of(scenario), None, notify)
