"""The report of a run: one HTML file that needs no network, no script and no other file."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from surefoot.disk import whole

from .judge import METRICS, RunVerdict
from .plots import Moment, Timing, draw, moments
from .traces import Traces


@dataclass(frozen=True)
class About:
    """Facts on a run that the report shows besides its numbers.

    Attributes:
        scenario: name of the scenario.
        description: one sentence.
        seed: seed of the run.
        facts: title and value pairs for the table at the end (versions, files, command to repeat it).
        limits: as in the scenario.
        feet: leg names in message order.
        timings: time in a tick by service.
    """

    scenario: str
    description: str = ""
    seed: int = 0
    facts: Mapping[str, str] = field(default_factory=dict[str, str])
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    feet: tuple[str, ...] = ()
    timings: Mapping[str, Timing] = field(default_factory=dict[str, Timing])


def write_report(path: Path, about: About, traces: Traces, verdict: RunVerdict) -> Path:
    """Write the report and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = render(about, traces, verdict)
    with whole(path) as part:
        part.write_text(text, encoding="utf-8")
    return path


def render(about: About, traces: Traces, verdict: RunVerdict) -> str:
    """Return the report as one HTML text."""
    plots = draw(traces, about.feet, about.timings, about.limits)
    body = "\n".join(
        [
            _head(about, verdict),
            _verdict_table(verdict),
            _what_happened(traces, moments(traces, about.feet), verdict),
            '<section class="plots">',
            *(f"<figure><figcaption>{_esc(title)}</figcaption>{svg}</figure>" for title, svg in plots.items()),
            "</section>",
            _facts(about, verdict),
        ]
    )
    title = f"{about.scenario}, seed {about.seed}: {_word(verdict)}"
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{_esc(title)}</title><style>{CSS}</style></head>\n<body><main>{body}</main></body></html>\n"
    )


def _head(about: About, verdict: RunVerdict) -> str:
    css = "pass" if verdict.ok else "fail"
    tiles = "".join(
        f"<div><b>{_esc(row.text)}</b><span>{_esc(METRICS[row.name].title)}</span></div>"
        for row in verdict.rows
        if row.name in ("distance_m", "max_tilt_deg", "mean_slip_mm", "min_margin_m", "real_time_factor")
        and row.value is not None
    )
    return (
        f'<header><span class="chip {css}">{_word(verdict)}</span><h1>{_esc(about.scenario)}</h1>'
        f"<p>{_esc(about.description)} &middot; seed {about.seed}</p></header>"
        f'<section class="tiles">{tiles}</section>'
    )


def _verdict_table(verdict: RunVerdict) -> str:
    rows = "".join(
        f'<tr class="{_css(row.ok)}"><td>{_esc(METRICS[row.name].title)}</td><td class="number">{_esc(row.text)}</td>'
        f'<td class="number">{_esc(row.limit_text)}</td><td>{_mark(row.ok)}</td></tr>'
        for row in verdict.rows
        if row.value is not None or row.limits
    )
    return (
        "<section><h2>Verdict</h2><table><thead><tr><th>Quantity</th><th class=number>Value</th>"
        f"<th class=number>Limit</th><th></th></tr></thead><tbody>{rows}</tbody></table></section>"
    )


def _what_happened(traces: Traces, worst: Sequence[Moment], verdict: RunVerdict) -> str:
    problems = "".join(f'<li class="bad">{_esc(problem)}</li>' for problem in verdict.problems)
    notes = "".join(f"<li>{_esc(note)}</li>" for note in verdict.notes)
    happened = [(event.time, event.text) for event in traces.events]
    happened += [(moment.time, moment.text) for moment in worst]
    listed = "".join(f"<li><time>t = {time:.2f} s</time> {_esc(text)}</li>" for time, text in sorted(happened)[:60])
    return f'<section><h2>Worst moments and events</h2><ul class="events">{problems}{notes}{listed}</ul></section>'


def _facts(about: About, verdict: RunVerdict) -> str:
    facts = dict(about.facts)
    if verdict.message_hash:
        facts["Message hash"] = verdict.message_hash + ("" if verdict.comparable else " (not comparable)")
    rows = "".join(
        f"<tr><td>{_esc(name)}</td><td><code>{_esc(value)}</code></td></tr>" for name, value in facts.items()
    )
    return f"<section><h2>This run</h2><table>{rows}</table></section>" if rows else ""


def _word(verdict: RunVerdict) -> str:
    return "PASS" if verdict.ok else "FAIL"


def _css(ok: bool | None) -> str:
    return "" if ok is None else ("good" if ok else "bad")


def _mark(ok: bool | None) -> str:
    return "" if ok is None else ("&#10003;" if ok else "&#10007;")


def _esc(text: str) -> str:
    return html.escape(text)


CSS = """
:root { --ink:#1c2733; --soft:#5d6b78; --line:#dfe5ea; --good:#2a9d63; --bad:#cc3b3b; --paper:#f4f6f8; }
* { box-sizing:border-box }
body { margin:0; background:var(--paper); color:var(--ink);
  font:15px/1.45 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",sans-serif }
main { max-width:1180px; margin:0 auto; padding:28px 20px 60px }
header { display:grid; grid-template-columns:auto 1fr; column-gap:14px; align-items:center }
h1 { margin:0; font-size:27px; letter-spacing:-.01em } h2 { font-size:16px; margin:0 0 10px }
header p { grid-column:1/-1; margin:6px 0 0; color:var(--soft) }
.chip { color:#fff; font-weight:700; font-size:14px; padding:4px 12px; border-radius:20px; letter-spacing:.05em }
.chip.pass { background:var(--good) } .chip.fail { background:var(--bad) }
.tiles { display:grid; grid-template-columns:repeat(auto-fit,minmax(170px,1fr)); gap:12px; background:none !important;
  padding:0 !important; border:0 !important }
.tiles div { background:#fff; border:1px solid var(--line); border-radius:10px; padding:12px 14px }
.tiles b { display:block; font-size:22px } .tiles span { color:var(--soft); font-size:12.5px }
section { background:#fff; border:1px solid var(--line); border-radius:10px; padding:16px 18px; margin-top:16px }
table { border-collapse:collapse; width:100% }
td,th { padding:5px 10px 5px 0; border-bottom:1px solid var(--line); text-align:left; vertical-align:top }
tr:last-child td { border-bottom:0 } th { color:var(--soft); font-weight:600; font-size:12.5px }
.number { text-align:right; font-variant-numeric:tabular-nums }
tr.good td:last-child { color:var(--good); font-weight:700 }
tr.bad td { color:var(--bad); font-weight:600 }
.events { margin:0; padding-left:18px } .events time { color:var(--soft); font-variant-numeric:tabular-nums }
.events .bad { color:var(--bad); font-weight:600 }
.plots { display:grid; grid-template-columns:repeat(auto-fit,minmax(min(540px,100%),1fr)); gap:14px; background:none;
  border:0; padding:0 }
figure { margin:0; background:#fff; border:1px solid var(--line); border-radius:10px; padding:12px 14px }
figcaption { font-weight:600; margin-bottom:6px } figure svg { width:100%; height:auto; display:block }
code { font:12.5px ui-monospace,SFMono-Regular,Menlo,Consolas,monospace; overflow-wrap:anywhere }
@media print { body { background:#fff } figure,section { break-inside:avoid } }
"""
