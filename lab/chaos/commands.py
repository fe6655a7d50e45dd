"""Command `surefoot chaos`: a scenario run with random faults that a seed determines."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..cli.completion import scenarios
from ..cli.output import (
    EXIT_CHECK,
    Json,
    Listen,
    near,
    notify,
    refuse_existing,
    use_json,
    write,
    write_json,
    write_table,
)
from ..cli.progress import Progress

if TYPE_CHECKING:
    from surefoot.services.supervisor.scenarios.scenario import Scenario

    from ..runs.live import Options
    from .events import ChaosOutcome, ChaosRun, Kind
    from .live import LiveRun
    from .run import MemoryRun

app = typer.Typer()


@app.command()
def chaos(
    scenario: Annotated[
        str,
        typer.Argument(help="Name of a scenario (see `surefoot list`) or path of its file.", autocompletion=scenarios),
    ],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first run's events.")] = 0,
    events: Annotated[int, typer.Option(min=0, help="Events in a run.")] = 5,
    runs: Annotated[int, typer.Option(min=1, help="Runs, with the seeds that follow.")] = 1,
    ticks: Annotated[
        int | None, typer.Option(min=1, help="Control ticks over which events are spread [half of the longest run].")
    ] = None,
    zenoh: Annotated[bool, typer.Option("--zenoh", help="Real processes: killed, ended, frozen, slowed.")] = False,
    paced: Annotated[bool, typer.Option("--paced", help="Time goes on, whoever is missing, it does not wait.")] = False,
    kinds: Annotated[
        str, typer.Option(help="Kinds of faults, separated by commas [each seed switches about half of them off].")
    ] = "",
    listen: Listen = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of recordings and reports with --zenoh [new ones under runs/], else of tests [.]."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what is in that folder.")] = False,
    json: Json = False,
) -> None:
    """Run a scenario with random faults drawn from a seed. Exit code 1: it was unsafe, or a service did not recover.

    In one process (the default) messages are dropped, doubled, reordered, delayed, corrupted and forged and services
    killed and frozen, in virtual time: a seed replays a failure to the bit. The events of a failure are left out as
    long as it stays the same, and what is left is written as a test. With --zenoh the processes of a live system are
    killed, ended, frozen and slowed, and a stranger forges commands.
    """
    use_json(json)
    if not zenoh and (force or listen is not None):
        raise typer.BadParameter("got --listen or --force without --zenoh, which alone has processes and a folder")
    found: list[ChaosRun] = []
    with Progress(f"chaos in {Path(scenario).stem}", "reports of runs that ended are kept") as progress:
        from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

        path = find_scenario(scenario)
        loaded = load_scenario(path)
        draw, seeds = _Draw(events, _chosen(kinds, zenoh=zenoh), ticks), range(seed, seed + runs)
        if zenoh:
            from ..runs.live import Options

            options = Options(rtf=1.0 if paced else None, listen=listen, out=out)
            for number in _prepared(loaded, seeds, options, force=force):
                found.append(_live(loaded, number, draw, options))
                progress.at(len(found) / runs)
        else:
            found += _in_memory(loaded, seeds, draw, progress, paced=paced)
    for run in found:
        if run.violations and not zenoh:
            with Progress(f"events that seed {run.seed} needs to fail", "no test was written"):
                _shrink(path, loaded, run, draw, out, paced=paced)
    if json:
        write_json(found)
    else:
        _show(found)
    if any(run.violations for run in found):
        raise typer.Exit(EXIT_CHECK)


def _chosen(text: str, *, zenoh: bool) -> "tuple[Kind, ...]":
    """Return the kinds of faults in a comma-separated list; empty = each seed draws its kinds."""
    from .events import LIVE, MEMORY

    known = (LIVE if zenoh else MEMORY).kinds
    wanted = [name.strip() for name in text.split(",") if name.strip()]
    for name in wanted:
        if name not in known:
            raise typer.BadParameter(f"got {name!r}, known are {', '.join(known)}", param_hint="--kinds")
    return tuple(kind for kind in known if kind in wanted)


@dataclass(frozen=True)
class _Draw:
    """Parameters by which a seed draws events: number of events, kinds (empty = by seed), ticks (None = default)."""

    events: int
    kinds: "tuple[Kind, ...]"
    ticks: int | None


def _in_memory(
    scenario: "Scenario", seeds: range, draw: _Draw, progress: Progress, *, paced: bool
) -> "list[MemoryRun]":
    """Run each seed on the in-memory bus, report which recoveries of `MARKS` were taken, and return the runs."""
    from .marks import MARKS, Marks
    from .run import run_chaos

    found: list[MemoryRun] = []
    half = set[str]()
    with Marks() as marks:
        for number, seed in enumerate(seeds):
            share = progress.part(number / len(seeds), (number + 1) / len(seeds), f"seed {seed}")
            run = run_chaos(scenario, seed, draw.events, draw.kinds, draw.ticks, paced=paced, progress=share)
            found.append(run)
            what = f"{len(run.outcomes)} events, {run.ticks} ticks, {run.unbound} forged refused"
            notify(f"{_named(run)}: {what}: {'; '.join(run.violations) or 'ok'}")
            if seed < seeds.start + len(seeds) // 2:
                half = set(marks.taken)
    taken, late = len(marks.taken), len(marks.taken - half)
    never = ", ".join(name for name in MARKS if name not in marks.taken) or "none"
    notify(f"{taken} of {len(MARKS)} recoveries taken, {late} of them first in the second half of the seeds")
    notify(f"never taken: {never}")
    return found


def _named(run: "ChaosRun") -> str:
    return f"seed {run.seed} ({', '.join(run.kinds)})"


def _shrink(path: Path, scenario: "Scenario", run: "ChaosRun", draw: _Draw, out: Path | None, *, paced: bool) -> None:
    """Write a pytest file that reproduces a failure with the fewest events that it needs."""
    from .run import drawn
    from .shrink import as_test, shrink_run

    events = drawn(scenario, run.seed, draw.events, run.kinds, draw.ticks)
    found = shrink_run(scenario, events, run.seed, paced=paced)
    target = (out or Path()) / f"test_{scenario.name}_seed{run.seed}.py".replace("-", "_")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(
        as_test(path.read_text(encoding="utf-8"), scenario.name, len(events), found, run.seed, paced=paced)
    )
    notify(
        f"seed {run.seed}: {len(found.events)} of {len(events)} events make it fail ({found.runs} runs); {near(target)}"
    )


def _prepared(scenario: "Scenario", seeds: range, options: "Options", *, force: bool) -> range:
    """Check output folders and world and compile kernels before the first live run; return the seeds."""
    from surefoot.bus.endpoint import to_listen
    from surefoot.services.supervisor.processes.ports import refuse_in_use
    from surefoot.services.supervisor.processes.startable import system_of

    from ..cli.before import check_system
    from ..cli.warming import warm_if_cold

    endpoint = to_listen(options.listen)
    if options.out is not None:
        for number in seeds:
            refuse_existing(_folder(options.out, number), force=force, folder=True)
    compose = system_of(scenario, os.environ)
    refuse_in_use(endpoint)
    check_system(compose, scenario.world, scenario.seed)
    warm_if_cold(compose, endpoint, notify)
    return seeds


def _folder(out: Path, seed: int) -> Path:
    return out / f"seed{seed}"


def _live(scenario: "Scenario", seed: int, draw: _Draw, options: "Options") -> "LiveRun":
    from .live import run_live

    if options.out is not None:
        options = replace(options, out=_folder(options.out, seed))
    run = run_live(scenario, seed, draw.events, options, kinds=draw.kinds, ticks=draw.ticks, notify=notify)
    state = "; ".join(run.violations) or "ok"
    bags = ", ".join(f"{name} {count} messages" for name, count in run.bags.items())
    where = "" if run.report is None else f"; {near(run.report)}"
    notify(f"{_named(run)}: {len(run.outcomes)} events, {run.ticks} ticks, {bags}: {state}{where}")
    return run


def _show(found: "list[ChaosRun]") -> None:
    columns = ("seed", "event", "of", "tick", "size", "at s", "noticed after s", "by", "recovered after s")
    write_table(columns, [row for run in found for row in _rows(run)], right=(0, 3, 4, 5, 6, 8))
    for run in found:
        for violation in run.violations:
            write(f"violation  seed {run.seed}: {violation}")
    bad, events = sum(bool(run.violations) for run in found), sum(len(run.outcomes) for run in found)
    fallen = sum(run.fell_at is not None for run in found)
    write(f"{len(found)} runs, {events} events, {fallen} runs with a fall, {bad} with a violation")


def _rows(run: "ChaosRun") -> list[tuple[object, ...]]:
    """Return a row of the result table for each event of a run."""
    return [
        (
            run.seed,
            outcome.event.kind,
            outcome.event.service,
            outcome.event.tick,
            outcome.event.count or f"{outcome.event.size:g} s",
            f"{outcome.began:.2f}",
            _after(outcome, outcome.noticed),
            outcome.by,
            _after(outcome, outcome.recovered),
        )
        for outcome in run.outcomes
    ]


def _after(outcome: "ChaosOutcome", at: float | None) -> str:
    """Return the time from the beginning of an event to `at`, s, as text; "-" if `at` is None."""
    return "-" if at is None else f"{at - outcome.began:.2f}"
