"""`surefoot chaos`: a scenario under faults from a seed."""

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.lab.cli.output import EXIT_CHECK, Json, tell, use_json, write, write_json, write_table

if TYPE_CHECKING:
    from surefoot.lab.runs.chaos import ChaosRun


def chaos(
    scenario: Annotated[str, typer.Argument(help="Name of a scenario (see `surefoot list`) or path of its file.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first run's events.")] = 0,
    events: Annotated[int, typer.Option(min=0, help="Events in a run.")] = 5,
    runs: Annotated[int, typer.Option(min=1, help="Runs, with the seeds that follow.")] = 1,
    json: Json = False,
) -> None:
    """Run a scenario in one process while messages are dropped, doubled, reordered, delayed, corrupted and forged, and
    services killed and frozen; a seed replays a failure to the bit. Exit code 1: something was unsafe."""
    from surefoot.lab.runs.chaos import run_chaos
    from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

    use_json(json)
    loaded = load_scenario(find_scenario(scenario))
    found = []
    for number in range(seed, seed + runs):
        run = run_chaos(loaded, number, events)
        found.append(run)
        state = "; ".join(run.violations) or "ok"
        tell(f"seed {number}: {len(run.outcomes)} events, {run.ticks} ticks, {run.unbound} forged refused: {state}")
    if json:
        write_json(found)
    else:
        columns = ("seed", "event", "of", "tick", "size", "at s", "recovered after s")
        write_table(columns, [row for run in found for row in _rows(run)], right=(0, 3, 4, 5, 6))
        bad = [str(run.seed) for run in found if run.violations]
        write(f"{len(found)} runs, {len(bad)} with a violation{': seeds ' * bool(bad)}{', '.join(bad)}")
    if any(run.violations for run in found):
        raise typer.Exit(EXIT_CHECK)


def _rows(run: "ChaosRun") -> list[tuple[object, ...]]:
    """Return a row of the table for each event of a run."""
    return [
        (
            run.seed,
            outcome.event.kind,
            outcome.event.service,
            outcome.event.tick,
            outcome.event.count or f"{outcome.event.size:g} s",
            f"{outcome.began:.2f}",
            "-" if outcome.recovered is None else f"{outcome.recovered - outcome.began:.2f}",
        )
        for outcome in run.outcomes
    ]
