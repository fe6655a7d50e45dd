"""The report of a run: one HTML file that needs no network and no other file."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from surefoot.disk import whole

from ..scene.film import Film, packed, reel
from ..scene.pages import REPLAY_BAR, page, stage
from .charts import charts
from .consistency import consistency
from .judge import METRICS, RunVerdict
from .moments import Moment, moments
from .plots import Timing, draw
from .traces import Traces

MOST_EVENTS = 200


@dataclass(frozen=True)
class About:
    """Facts on a run that its report shows besides the metrics.

    Attributes:
        scenario: name of the scenario.
        description: one sentence.
        seed: seed of the run.
        facts: title and value pairs for the table at the end (versions, files, command to repeat it).
        limits: limits by key of `LIMITS`, as in the scenario.
        feet: leg names in message order.
        timings: computing time per control tick, by service.
        no_film: reason why there is no replay, in words; empty = not stated.
    """

    scenario: str
    description: str = ""
    seed: int = 0
    facts: Mapping[str, str] = field(default_factory=dict[str, str])
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    feet: tuple[str, ...] = ()
    timings: Mapping[str, Timing] = field(default_factory=dict[str, Timing])
    no_film: str = ""


def write_report(path: Path, about: About, traces: Traces, verdict: RunVerdict, film: Film | None = None) -> Path:
    """Write the HTML report of a run and return its path; with a film it includes a replay."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = render(about, traces, verdict, film)
    with whole(path) as part:
        part.write_text(text, encoding="utf-8", errors="backslashreplace")  # bytes of a file's name
    return path


def render(about: About, traces: Traces, verdict: RunVerdict, film: Film | None = None) -> str:
    """Return the report of a run as one HTML text."""
    worst = moments(traces, about.feet)
    figures = "".join(
        f"<figure><figcaption>{_esc(name)}</figcaption>{svg}</figure>"
        for name, svg in draw(traces, about.timings).items()
    )
    shown = film is not None and bool(film.snapshots)
    data = {
        "charts": charts(traces, about.feet, about.limits, worst),
        "film": reel(film) if film is not None and shown else None,
    }
    body = "\n".join(
        [
            _head(about, verdict),
            stage("replay", REPLAY_BAR) if shown else _no_film(about),
            f'<section class="columns"><div>{_verdict_table(verdict)}{_consistency_table(traces)}</div>'
            f"<div>{_what_happened(traces, worst, verdict)}</div></section>",
            "<noscript><section>The replay and the plots over time need scripts.</section></noscript>",
            f'<div id="charts" class="plots"></div><div class="plots">{figures}</div>',
            _facts(about, verdict),
            f'<script type="text/plain" id="data">{packed(data)}</script>',
        ]
    )
    title = f"{about.scenario}, seed {about.seed}: {verdict.word}"
    return page(title, f"<main>{body}</main>", ("scene.js", "charts.js", "replay.js"), "startReport();")


def _no_film(about: About) -> str:
    why = about.no_film or "the messages hold no posture of the robot"
    return f'<section class="note">No replay: {_esc(why)}.</section>'


def _consistency_table(traces: Traces) -> str:
    rows = "".join(
        f'<tr class="{"" if test.verdict == "consistent" else "doubt"}"><td>{_esc(test.name)}</td>'
        f"<td>{_esc(test.text)}</td></tr>"
        for test in consistency(traces)
    )
    return f'<h2 style="margin-top:22px">Consistency of the filters</h2><table>{rows}</table>' if rows else ""


def _head(about: About, verdict: RunVerdict) -> str:
    css = {"FAIL": "fail", "NO VERDICT": "open"}.get(verdict.word, "pass")
    tiles = "".join(
        f"<div><b>{_esc(row.text)}</b><span>{_esc(METRICS[row.name].title)}</span></div>"
        for row in verdict.rows
        if row.name in ("distance_m", "max_tilt_deg", "mean_slip_mm", "min_margin_m", "real_time_factor")
        and row.value is not None
    )
    why = f'<p class="why"><b>Why</b> {_esc(verdict.why)}</p>' if verdict.why else ""
    return (
        f'<header><span class="chip {css}">{verdict.word}</span><h1>{_esc(about.scenario)}</h1>'
        f"<p>{_esc(about.description)} &middot; seed {about.seed}</p>{why}</header>"
        f'<div class="tiles">{tiles}</div>'
    )


def _verdict_table(verdict: RunVerdict) -> str:
    rows = "".join(
        f'<tr class="{_css(row.ok)}"><td>{_esc(METRICS[row.name].title)}</td><td class="number">{_esc(row.text)}</td>'
        f'<td class="number">{_esc(row.limit_text)}</td><td>{_mark(row.ok)}</td></tr>'
        for row in verdict.rows
        if row.value is not None or row.limits
    )
    return (
        "<h2>Verdict</h2><table><thead><tr><th>Quantity</th><th class=number>Value</th>"
        f"<th class=number>Limit</th><th></th></tr></thead><tbody>{rows}</tbody></table>"
    )


def _what_happened(traces: Traces, worst: Sequence[Moment], verdict: RunVerdict) -> str:
    problems = "".join(f'<li class="bad">{_esc(problem)}</li>' for problem in verdict.problems)
    notes = "".join(f"<li>{_esc(note)}</li>" for note in verdict.notes if note != verdict.why)
    happened = [(event.time, "", event.text) for event in traces.events]
    happened += [(moment.time, "worst", moment.text) for moment in worst]
    listed = "".join(
        f'<li class="{css}"><button data-t="{time:.3f}"><time>t = {time:.2f} s</time> {_esc(text)}</button></li>'
        for time, css, text in sorted(happened)[:MOST_EVENTS]
    )
    return f'<h2>Worst moments and events</h2><ul class="events">{problems}{notes}{listed}</ul>'


def _facts(about: About, verdict: RunVerdict) -> str:
    facts = dict(about.facts)
    if verdict.message_hash:
        facts["Message hash"] = verdict.message_hash + ("" if verdict.comparable else " (not comparable)")
    rows = "".join(
        f"<tr><td>{_esc(name)}</td><td><code>{_esc(value)}</code></td></tr>" for name, value in facts.items()
    )
    return f"<section><h2>This run</h2><table>{rows}</table></section>" if rows else ""


def _css(ok: bool | None) -> str:
    return "" if ok is None else ("good" if ok else "bad")


def _mark(ok: bool | None) -> str:
    return "" if ok is None else ("&#10003;" if ok else "&#10007;")


def _esc(text: str) -> str:
    return html.escape(text)
