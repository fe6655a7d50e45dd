"""Command `surefoot evaluate`: statistics of a navigation policy, or of a fitted navigation model, over episodes."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..cli.output import Json, use_json, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from surefoot.services.navigator.policy.params import NavigationModel

    from .evaluation import Seeds

evaluate = typer.Typer(
    name="evaluate", help="Measure how good something is that was trained or fitted.", no_args_is_help=True
)

MAX_EPISODES = 1_000_000


@evaluate.callback()
def _group() -> None:
    """Measure the performance of a trained policy or a fitted model."""


def seeds_of(text: str) -> "Seeds":
    """Return the episodes A to B - 1 of a text `A:B` (raises SurefootError: other text, not 2 to 1,000,000)."""
    from surefoot.errors import SurefootError

    from .evaluation import Seeds

    match = re.fullmatch(r"(\d{1,12}):(\d{1,12})", text)
    if match is None or not 1 < int(match[2]) - int(match[1]) <= MAX_EPISODES:
        raise SurefootError(
            "invalid", f"got {text!r}, allowed is A:B with 2 to {MAX_EPISODES} episodes A to B - 1", "seeds"
        )
    return Seeds(int(match[1]), int(match[2]))


def model_of(params: str, settings: list[str] | None, actions: str | None) -> "NavigationModel":
    """Return the navigation model `params` (name or TOML file) with `key=value` settings and action set."""
    from surefoot.services.navigator.policy.params import load

    return load(params, [*(settings or []), *([f'use="{actions}"'] if actions else [])])


@evaluate.command("navigator")
def navigator(
    policy: Annotated[str, typer.Option("--policy", "-p", help="Name or file of a policy, or `limit`.")] = "planner",
    params: Annotated[str, typer.Option("--params", help="Name or TOML file of a navigation model.")] = "paper",
    seeds: Annotated[str, typer.Option("--seeds", help="Episodes A:B, from A up to but without B.")] = "0:1000",
    against: Annotated[str | None, typer.Option("--against", help="Another policy on the same episodes.")] = None,
    actions: Annotated[str | None, typer.Option("--actions", help="Action set, e.g. four or arcs.")] = None,
    against_actions: Annotated[
        str | None, typer.Option("--against-actions", help="Action set of the other, if it differs.")
    ] = None,
    against_set: Annotated[
        list[str] | None, typer.Option("--against-set", help="key=value for the other only, e.g. filter.states=3.")
    ] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value of the model; repeatable.")] = None,
    json: Json = False,
) -> None:
    """Evaluate a policy in simulated episodes; the policy `limit` is a planner that knows true pose and drift."""
    use_json(json)
    chosen = seeds_of(seeds)
    with Progress(f"{chosen.count} episodes of {policy}") as progress:
        from .evaluation import paired, summary

        model, end = model_of(params, settings, actions), 1.0 if against is None else 0.5
        results, about = _measured(model, policy, chosen, progress.part(0.0, end))
        found: dict[str, Any] = {
            "params": params,
            "model_sha256": model.sha256(),
            "actions": model.use,
            "seeds": (chosen.first, chosen.end),
            "policy": {**about, **summary(results)},
        }
        if against is not None:
            both = [*(settings or []), *(against_set or [])]
            other_model, share = model_of(params, both, against_actions or actions), progress.part(end, 1.0, against)
            other, other_about = _measured(other_model, against, chosen, share)
            found["against"] = {**other_about, **summary(other)}
            found["paired"] = paired(results, other)
    if json:
        write_json(found)
    else:
        _show(found)


def _measured(
    model: "NavigationModel", name: str, seeds: "Seeds", progress: Callable[[float], None]
) -> tuple[Any, dict[str, Any]]:
    from surefoot.services.navigator.policy.arrays import arrays
    from surefoot.services.navigator.policy.library import find

    from .evaluation import episodes

    world = arrays(model)
    knows = name == "limit"
    policy = find("planner" if knows else name, model, world, any_model=True)
    about = {
        "name": Path(name).stem if name.endswith(".npz") else name,
        "sha256": policy.sha256,
        "provenance": dict(policy.provenance),
    }
    return episodes(world, policy, seeds, knows=knows, progress=progress), about


def _show(found: dict[str, Any]) -> None:
    rows = [_row(found[who]) for who in ("policy", "against") if who in found]
    columns = ("policy", "mean", "95 %", "sd", "median", "p95", "success", "at least", "stands", "turns", "NEES (3)")
    write_table(columns, rows, f"{found['params']}, {found['actions']}, seconds to the goal", right=range(1, 11))
    if "paired" in found:
        p = found["paired"]
        low, high = p["difference_ci95_percent"]
        write_table(
            ("difference", "s", "%", "95 %", "p"),
            [
                (
                    "policy - against",
                    f"{p['difference_s']:.2f}",
                    f"{p['difference_percent']:.2f}",
                    f"{low:.2f} .. {high:.2f}",
                    f"{p['p_paired_t']:.1e}",
                )
            ],
            right=range(1, 5),
        )


def _row(s: dict[str, Any]) -> tuple[str, ...]:
    low, high = s["mean_ci95_s"]
    return (
        s["name"],
        f"{s['mean_s']:.2f}",
        f"{low:.2f} .. {high:.2f}",
        f"{s['sd_s']:.2f}",
        f"{s['median_s']:.2f}",
        f"{s['p95_s']:.1f}",
        f"{s['success']:.4f}",
        f"{s['success_at_least']:.4f}",
        f"{s['stands']:.1f}",
        f"{s['turns']:.1f}",
        f"{s['nees']:.2f}",
    )
