"""Generator of the page docs/topics.md: `python -m surefoot.lab.topics_page > docs/topics.md`."""

import inspect
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from surefoot.schemas.base import Wire
from surefoot.schemas.topics import QUERIES, TOPICS, Topic

_HEAD = """# Topics and queries
Generated from `schemas/topics.py` and the models beside it; do not edit. After a change of either:
`python -m surefoot.lab.topics_page > docs/topics.md`.

Fields, units and frames of a message: `surefoot topic info <key>`; of a request and its reply:
`surefoot service info <key>`; the frames themselves: [frames.md](frames.md). Keys are relative to `surefoot/<robot>`.
The owner is the one service that publishes the topic or answers the query: `driver` is the simulator or a hardware
driver, `*` is every service, and a key that ends in `/*` has one member per service.
"""
_TOPICS = """## Topics
The rate is in simulated time unless it is marked as wall time; an event has none. Topics in the run hash have the same
bytes for the same seed.
"""
_QUERIES = """## Queries
A query that acts changes the state of its owner, so it refuses an empty request. The time limit is the caller's
default.
"""


def page() -> str:
    """Return the page docs/topics.md as Markdown: every topic and query."""
    topics = table(
        ("key", "message", "kind", "rate, Hz", "owner", "in run hash", "what it is"),
        ((f"`{t.key}`", t.model.__name__, t.kind.value, rate(t), t.owner, _yes(t.deterministic), summary(t.model))
         for t in TOPICS),
    )  # fmt: skip
    queries = table(
        ("key", "request", "reply", "owner", "time limit, s", "acts", "what it is"),
        ((f"`{q.key}`", q.request.__name__, q.reply.__name__, q.owner, f"{q.timeout_s:g}", _yes(q.acts),
          summary(q.request)) for q in QUERIES),
    )  # fmt: skip
    return "\n".join((_HEAD, _TOPICS, topics, _QUERIES, queries))


def rate(topic: Topic[Any]) -> str:
    """Return the rate of a topic in Hz as text, in simulated time unless marked; `event` if it has no period."""
    if topic.rate_hz == 0.0:
        return "event"
    if topic.wall_period_s:
        return f"{topic.rate_hz:g} (wall time)"
    return f"{topic.rate_hz:.3g}" + (f", or {topic.own_rate}" if topic.own_rate else "")


def summary(model: type[Wire]) -> str:
    """Return the first paragraph of a model's docstring in one line."""
    return " ".join((inspect.getdoc(model) or "").partition("\n\n")[0].split()).replace("``", "`")


def _yes(flag: bool) -> str:
    return "yes" if flag else "-"


def table(names: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown text; `names`: titles of the columns, `rows`: cells of each row."""
    lines = [names, ["---"] * len(names), *(tuple(cell.replace("|", "\\|") for cell in row) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    sys.stdout.write(page())
