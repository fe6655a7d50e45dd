"""Commands `surefoot train` and `surefoot evaluate`: make navigation policies, and measure their performance."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..cli.output import Json, near, notify, refuse_existing, use_json, write_json, write_table
from ..cli.progress import Progress
from .evaluate import evaluate, model_of

if TYPE_CHECKING:
    from .runs import Trained

train = typer.Typer(name="train", help="Make policies.", no_args_is_help=True)
app = typer.Typer()
app.add_typer(train)
app.add_typer(evaluate)


@train.callback()
def _group() -> None:
    """Compute or learn navigation policies (group of commands `surefoot train`)."""


@train.command("navigator")
def navigator(
    out: Annotated[Path, typer.Option("--out", "-o", help="Policy file to write (.npz).")],
    policy: Annotated[str, typer.Option("--policy", "-p", help="What to make: planner or sarsa.")] = "planner",
    params: Annotated[str, typer.Option("--params", help="Name or TOML file of a navigation model.")] = "paper",
    actions: Annotated[str | None, typer.Option("--actions", help="Action set, e.g. four or arcs.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value of the model; repeatable.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, max=10**9, help="Seed of the (first) training.")] = 0,
    runs: Annotated[int, typer.Option("--runs", min=1, max=1000, help="Trainings; the best of them is kept.")] = 1,
    episodes: Annotated[int, typer.Option("--episodes", min=1, max=10**7, help="Of a training (sarsa).")] = 1500,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the checkpoints beside --out.")] = False,
    json: Json = False,
) -> None:
    """Compute (planner) or learn (sarsa) a navigation policy for a model.

    Trainings run on all cores. Of several the one with the least mean time on episodes of their own is kept; all are
    listed. A checkpoint of each is kept beside --out until all are done.
    """
    from surefoot.errors import SurefootError

    use_json(json)
    if policy not in ("planner", "sarsa"):
        raise SurefootError("invalid", f"got {policy!r}, allowed are planner, sarsa", "policy")
    if out.suffix != ".npz":
        raise SurefootError("invalid", f"got {str(out)!r}, allowed is a file *.npz", "out")
    if not out.parent.is_dir():
        raise SurefootError("invalid", f"folder {str(out.parent)!r} does not exist", "out")
    refuse_existing(out, force=True)
    kept = "nothing was written"
    if policy == "sarsa":
        kept = f"checkpoints are kept beside {near(out)}, and --resume goes on from them"
    with Progress(f"policy {out.name}", kept) as progress:
        from surefoot.services.navigator.policy.files import save

        from .runs import make_planner, make_sarsa
        from .sarsa import Schedule

        model = model_of(params, settings, actions)
        if policy == "planner":
            made, trained = make_planner(model), list["Trained"]()
        else:
            schedule = Schedule(episodes=episodes)
            made, trained = make_sarsa(model, schedule, seed, runs, out, resume=resume, progress=progress.at)
        digest = save(made, out)
    found: dict[str, Any] = {
        "file": near(out),
        "sha256": digest,
        "provenance": dict(made.provenance),
        "trainings": [vars(t) for t in trained],
    }
    if json:
        write_json(found)
        return
    if trained:
        rows = [(t.seed, f"{t.mean_s:.2f}", f"{t.success:.4f}", "kept" if t.kept else "") for t in trained]
        write_table(("seed", "mean, s", "success", ""), rows, "trainings", right=(0, 1, 2))
    notify(f"{near(out)}: {made.name} for {', '.join(made.actions)}, sha256 {digest[:12]}")
