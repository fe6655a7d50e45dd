"""Commands of slip models for footholds: `surefoot footholds collect|primitives|learn|tune|merge|show|judge|score`."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..cli.completion import robots
from ..cli.output import Json, refuse_existing, use_json, write, write_answer, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from .walks import Setting

app = typer.Typer(
    name="footholds",
    help="Slip models: collect stances, learn from them, look at what was learned.",
    no_args_is_help=True,
)
Model = Annotated[str, typer.Option("--model", "-m", help="Model file, or the name of a robot with a shipped one.")]
Grounds = Annotated[
    list[str], typer.Option("--ground", help="KIND or KIND:HEIGHT (m) of the simulator; more than one is possible.")
]
Seeds = Annotated[str, typer.Option("--seeds", help="first:end")]
Jobs = Annotated[int, typer.Option(min=1, help="Walks at a time, a process each.")]
Friction = Annotated[float, typer.Option(min=0.0, max=10.0, help="Coefficient of the ground.")]
Distance = Annotated[float, typer.Option(min=0.1, max=2.0, help="Way of each walk, m.")]


@app.command()
def collect(
    out: Annotated[Path, typer.Option("--out", "-o", help="File of samples; a file that is there is gone on with.")],
    ground: Grounds = ["rough:0.04", "mixed"],  # noqa: B006 - typer reads it once
    seeds: Seeds = "1000:1040",
    robot: str = "ragno",
    friction: Friction = 0.5,
    profile: Annotated[list[str], typer.Option(help="Maps: exact, noise or shifted.")] = ["exact", "noise"],  # noqa: B006
    distance: Distance = 0.9,
    model: Annotated[str, typer.Option("--model", "-m", help="Model that chooses; empty = all at random.")] = "",
    explore: Annotated[float, typer.Option(min=0.0, max=1.0, help="With --model: share of random steps.")] = 0.2,
    jobs: Jobs = 1,
    json: Json = False,
) -> None:
    """Walk with random footholds in the simulator and append the outcome of every stance to a file."""
    use_json(json)
    with _Count(out) as count:
        from .campaign import collect as campaign
        from .campaign import planned

        if model:
            _load(model)
        grounds = [_ground(each, robot, friction, distance) for each in ground]
        trials = planned(grounds, profile, _seeds(seeds), model, explore)
        count.trials = len(trials)
        walked = campaign(trials, out, jobs, lambda trial, stances: count.show(trial.name, stances))
    count.write({"walked": walked}, json)


@app.command()
def primitives(
    out: Annotated[Path, typer.Option("--out", "-o", help="File of samples; a file that is there is gone on with.")],
    worker: Annotated[
        list[str],
        typer.Option(help="Simulators on the network, NAMESPACE@ENDPOINT; none: this process does it."),
    ] = [],  # noqa: B006
    robot: str = "ragno",
    friction: Annotated[list[float], typer.Option(min=0.01, max=10.0, help="Coefficients of the ground.")] = [0.5],  # noqa: B006
    noise: Annotated[float, typer.Option(min=0.0, max=0.01, help="Deviation of the heights, m.")] = 0.0,
    offset: Annotated[float, typer.Option(min=0.0, max=0.02, help="Feet off the middle, m.")] = 0.0,
    stance: Annotated[str, typer.Option(help="six or tripod.")] = "tripod",
    seeds: Seeds = "0:1",
    json: Json = False,
) -> None:
    """Test seven ground primitives with all feet (Walas & Belter, 3.1) and append the outcomes to a file."""
    from contextlib import nullcontext

    from surefoot.errors import SurefootError
    from surefoot.robot.reader import load_robot

    from .primitives import own_worker, paper_trials, run_trials
    from .workers import remote_workers

    use_json(json)
    if stance not in ("six", "tripod"):
        raise SurefootError("invalid", f"must be six or tripod, got {stance!r}", "stance")
    described = load_robot(robot)
    trials = paper_trials(friction, noise, list(_seeds(seeds)), offset, stance)
    pool = remote_workers(worker) if worker else nullcontext([own_worker(described)])
    with _Count(out, len(trials)) as count, pool as workers:
        done = run_trials(described, trials, out, workers, count.show)
    count.write({"done": done}, json)


@app.command()
def gather(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings (.mcap) of walks, whoever commanded them.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File of samples; recordings it holds are left out.")],
    robot: Annotated[
        str, typer.Option(help="Name or folder; empty = that of each recording.", autocompletion=robots)
    ] = "",
    exact: Annotated[bool, typer.Option("--exact", help="The map has no noise: no median over it.")] = False,
    json: Json = False,
) -> None:
    """Append the stances of recorded walks to a file of samples, with the slip that the estimator measured."""
    use_json(json)
    with _Count(out, len(recordings), recordings) as count:
        from surefoot.record.recording import open_readable
        from surefoot.record.robots import robot_for

        from .campaign import append, read
        from .recorded import samples_of

        count.at(0.0)
        done = read(out)[1] if out.exists() else {}
        missing = [path for path in recordings if path.stem not in done]
        for number, path in enumerate(missing):
            share = count.part(number / len(missing), (number + 1) / len(missing), path.name)
            walked = robot_for(open_readable(path), robot)
            found = samples_of(path, walked, not exact, share)
            append(out, path.stem, found)
            count.show(path.stem, len(found))
    count.write({"gathered": len(missing)}, json)


@app.command()
def learn(
    samples: Annotated[list[Path], typer.Argument(help="Files of samples.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Model file to write.")],
    title: Annotated[str, typer.Option(help="Name of the model.")] = "learned",
    weight: Annotated[float, typer.Option(min=0.0, help="k of Q = P + k K4, 1/m; see tune.")] = 0.5,
    landing_error: Annotated[float, typer.Option(min=0.0, max=0.03, help="m; 0 = mean over 3 x 3 cells.")] = 0.005,
    support: Annotated[int, typer.Option(min=0, help="Least samples of a cell's bin; 0 = ranges only.")] = 0,
    folds: Annotated[int, typer.Option(min=2, help="Of whole trials, for the choice of size.")] = 5,
    terms: Annotated[int | None, typer.Option(min=1, help="Of the sum; none = chosen by the folds.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Equal samples and seed, equal bytes.")] = 0,
    json: Json = False,
) -> None:
    """Learn a slip model from samples; the size of the fit is chosen by cross-validation over trials."""
    use_json(json)
    refuse_existing(out, force=True)
    with Progress(f"slip model {title}", reads=samples) as progress:
        from dataclasses import asdict

        from surefoot.services.footholds.learning import fit
        from surefoot.services.footholds.learning.samples import gather
        from surefoot.services.footholds.models.files import save

        from .campaign import read

        found = [read(path) for path in samples]
        gathered = gather(each for part in found for each in part[0])
        options = fit.LearnOptions(
            candidates=fit.candidates(terms), title=title, folds=folds, seed=seed, distance_weight=weight,
            landing_error=landing_error, support=support,
        )  # fmt: skip
        model, beside = fit.learn_and_compare(gathered, options, progress.and_on)
        save(model, out)
    facts = {"out": str(out), "model": model.name, "refused": gathered.refused, "choice": model.choice}
    facts |= {"unreadable_lines": sum(part[2] for part in found)}
    if json:
        rows = [asdict(row) for row in beside.rows]
        write_json({**facts, "held_back": beside.by, "compared": rows, "warning": beside.warning})
        return
    write_table(("quantity", "value"), [(name.replace("_", " "), value) for name, value in facts.items()])
    header = ("predictor", "R2", "rank", "AUC", "80 % intervals hold")
    table = [(row.name, *(f"{v:.3f}" for v in (row.r2, row.rank, row.auc, row.held))) for row in beside.rows]
    write_table(header, table, f"on {beside.by} held back", right=(1, 2, 3, 4))
    if beside.warning:
        write(f"warning: the model {beside.warning}")


@app.command()
def tune(
    model: Annotated[Path, typer.Argument(help="Model file; its k is written anew.")],
    weights: Annotated[str, typer.Option(help="k to try, 1/m.")] = "0.3,0.5,0.8,2",
    ground: Grounds = ["rough:0.04", "mixed"],  # noqa: B006
    seeds: Seeds = "500:505",
    robot: str = "ragno",
    friction: Friction = 0.5,
    distance: Distance = 0.9,
    jobs: Jobs = 1,
    json: Json = False,
) -> None:
    """Choose a slip model's weight k of the distance to the nominal foothold, by simulated walks on training seeds."""
    from dataclasses import replace

    from surefoot.services.footholds.models.files import load, save

    from .tuning import best_of, try_weights

    use_json(json)
    loaded = load(model)
    grounds = [_ground(each, robot, friction, distance) for each in ground]
    numbers, wanted = [_number(each, "weights") for each in weights.split(",")], _seeds(seeds)
    with Progress(f"weights of {model.name}", "the model is as it was") as progress:
        tried = try_weights(loaded, grounds, wanted, numbers, jobs, progress.at)
    best = best_of(tried)
    save(replace(loaded, distance_weight=best.weight), model)
    if json:
        write_json({"chosen": best.weight, "tried": [vars(each) for each in tried]})
        return
    rows = [(f"{t.weight:g}", *(f"{v:.3f}" for v in t.sliding_mm), str(t.failed)) for t in tried]
    write_table(("k, 1/m", *(f"{each}, mm" for each in ground), "failed"), rows)
    write(f"chosen  {best.weight:g}")


@app.command()
def merge(
    first: Annotated[Path, typer.Argument(help="Model file; its name, k and size of fit stay.")],
    second: Annotated[Path, typer.Argument(help="Model file of other samples.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Model file to write.")],
    weight: Annotated[float, typer.Option(min=0.0, max=1.0, help="How much samples of the second count.")] = 1.0,
    json: Json = False,
) -> None:
    """Merge two slip models; with weight 1 the bins equal those of a model of all samples, to the byte."""
    from surefoot.services.footholds.learning.merge import merge as joined
    from surefoot.services.footholds.models.files import load, save

    use_json(json)
    refuse_existing(out, force=True)
    with Progress(out.name):
        model = joined(load(first), load(second), weight)
        save(model, out)
    write_answer(
        {"out": str(out), "model": model.name, "bins": len(model.bins)}, f"{out}: {model.name}, {len(model.bins)} bins"
    )


@app.command()
def show(
    model: Annotated[str, typer.Argument(help="Model file, or the name of a robot with a shipped one.")],
    picture: Annotated[Path | None, typer.Option("--picture", help="Draw P over (K1, K2) and the support.")] = None,
    json: Json = False,
) -> None:
    """Show the content of a slip model: conditions, ranges, fit, origin of its samples."""
    use_json(json)
    found = _load(model)
    ranges = dict(zip(("K1 / 8 cells", "K2 / 8 cells", "cos K3"), found.ranges, strict=True))
    facts: dict[str, object] = {
        "model": found.name, "robot": found.conditions.robot, "cell_m": found.conditions.cell,
        "median_filter": found.conditions.smooth, "foot_radius_m": found.conditions.foot_radius,
        "k_per_m": found.distance_weight, "landing_error_m": found.landing_error,
        "terms": len(found.terms.weights), "bins": len(found.bins), "least_support": found.support,
        "table_error": found.table_error(), **found.choice,
    }  # fmt: skip
    if picture is not None:
        with Progress(f"picture {picture.name}"):
            from .picture import draw

            draw(found, picture)
    if json:
        write_json({**facts, "ranges": ranges, "provenance": found.provenance})
        return
    rows = [(name.replace("_", " "), f"{v:.4g}" if isinstance(v, float) else str(v)) for name, v in facts.items()]
    rows += [(f"range of {name}", f"{low:.3f} to {high:.3f}") for name, (low, high) in ranges.items()]
    write_table(("quantity", "value"), rows)
    for line in found.provenance:
        write(f"source  {line}")
    if picture is not None:
        write(f"figure  {picture}")


@app.command()
def judge(
    model: Annotated[str, typer.Argument(help="Model file, or the name of a robot with a shipped one.")],
    samples: Annotated[list[Path], typer.Argument(help="Samples of trials that the model was not made of.")],
    json: Json = False,
) -> None:
    """Report how well a slip model predicts stances: rank correlation, AUC of slips over twice flat, 80 % intervals."""
    use_json(json)
    with Progress(f"quality of {model}"):
        from surefoot.errors import SurefootError
        from surefoot.services.footholds.learning.quality import prediction_quality

        from .campaign import read

        found = [each for path in samples for each in read(path)[0]]
        if not found:
            raise SurefootError("no_samples", "the files hold no stance of a complete trial", "samples")
        result = prediction_quality(_load(model), found)
    facts = {
        "stances": result.stances, "spearman": result.spearman, "auc": result.warned, "held": result.held,
        "ceiling": result.ceiling,
    }  # fmt: skip
    if json:
        write_json(facts)
    else:
        write_table(("quantity", "value"), [(name, f"{value:.4g}") for name, value in facts.items()])


@app.command()
def score(
    map: Annotated[Path, typer.Argument(help="Height map: .npz, .asc, .png, GeoTIFF, or a bag with a grid_map.")],
    model: Model,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Layers z, k1, k2, cos_k3, p, mask, spread, support, clear: .npz.")
    ],
    picture: Annotated[Path | None, typer.Option("--picture", help="Draw heights, P, support and free cells.")] = None,
    heading: Annotated[
        float, typer.Option(min=-7.0, max=7.0, help="Of the walk, rad: the feet move the other way.")
    ] = 0.0,
    json: Json = False,
) -> None:
    """Score the ground of a height map file by a slip model; no running system is needed."""
    import math

    use_json(json)
    refuse_existing(out, force=True)
    with Progress(f"scores of {map.name}") as progress:
        from surefoot.services.footholds.masks import REASONS

        from .scored import read_map, save_scored, score_map

        found, heights = _load(model), read_map(map)
        stroke = (-0.025 * math.cos(heading), -0.025 * math.sin(heading), 0.0)
        scored = score_map(heights, found, found.conditions.foot_radius, stroke, found.conditions.smooth)
        save_scored(scored, heights, found, out)
        progress.kept = f"{out} is written"
        if picture is not None:
            from .picture import draw_scored
            from .scored import LAYERS

            draw_scored(dict(zip(LAYERS, scored.layers, strict=True)), heights.cell, heights.origin, picture)
    counts = dict(zip((*REASONS, "free"), scored.counts, strict=True))
    if json:
        write_json({"out": str(out), "model": found.name, "cells": counts})
    else:
        write_table(("cells", "number"), [(name, str(count)) for name, count in counts.items()], found.name, right=(1,))


class _Count(Progress):
    """Counter of the trials of a campaign: reports progress, and a summary line at the end."""

    def __init__(self, out: Path, trials: int = 0, reads: Iterable[Path] = ()) -> None:
        super().__init__(out.name, f"what is done is in {out}, and the same command goes on from there", reads=reads)
        self.trials, self.out, self.done, self.samples = trials, out, 0, 0

    def show(self, name: str, stances: int) -> None:
        """Count a completed trial with its number of stances, and report the progress of the campaign."""
        self.done, self.samples = self.done + 1, self.samples + stances
        self.at(self.done / self.trials, f"{self.done} of at most {self.trials}: {name}, {stances} stances")

    def write(self, did: dict[str, int], json: bool) -> None:
        """Print the number of completed trials, `did` (verb to number), and of samples, as a line or as JSON."""
        if json:
            write_json({"out": str(self.out), "trials": self.trials, **did, "samples": self.samples})
            return
        ((verb, number),) = did.items()
        write(f"{self.out}: {number} of {self.trials} trials {verb}, {self.samples} samples added")


def _load(name: str):
    from surefoot.services.footholds.models.files import load, shipped

    return load(shipped(name) or name)


def _ground(text: str, robot: str, friction: float, distance: float) -> "Setting":
    from surefoot.errors import SurefootError
    from surefoot.robot.reader import load_robot
    from surefoot.services.simulator.ground.terrain import KINDS

    from .walks import Setting

    load_robot(robot)  # an unknown one is reported before anything is written
    kind, _, height = text.partition(":")
    if kind not in KINDS:
        raise SurefootError("invalid", f"got {kind!r}, known are {', '.join(KINDS)}", "ground")
    amplitude = _number(height, "ground") if height else None
    return Setting(terrain=kind, distance=distance, amplitude=amplitude, friction=friction, robot=robot)


def _seeds(text: str) -> range:
    from surefoot.errors import SurefootError

    first, colon, end = text.partition(":")
    if not (colon and first.isdigit() and end.isdigit() and int(first) < int(end)):
        raise SurefootError("invalid", f"must be first:end with first < end, got {text!r}", "seeds")
    return range(int(first), int(end))


def _number(text: str, field: str) -> float:
    import math

    from surefoot.errors import SurefootError

    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SurefootError("invalid", f"must be a number, got {text!r}", field)
    return value
