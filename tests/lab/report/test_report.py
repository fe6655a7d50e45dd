"""The report is one file that stands alone."""

import base64
import gzip
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from surefoot.lab.report.charts import charts
from surefoot.lab.report.consistency import NIS, consistency
from surefoot.lab.report.judge import judge
from surefoot.lab.report.moments import moments
from surefoot.lab.report.page import About, render, write_report
from surefoot.lab.report.plots import Timing
from surefoot.lab.report.traces import Traces

FEET = ("lf", "lm", "lh", "rf", "rm", "rh")
VOID = {"meta", "br", "hr", "img", "input", "link"}


class Nesting(HTMLParser):
    """Checks that every element is closed, and collects ids and references."""

    def __init__(self):
        super().__init__()
        self.open = []
        self.ids = []
        self.references = []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        self._collect(attrs)

    def handle_startendtag(self, tag, attrs):
        self._collect(attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def _collect(self, attrs):
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name.endswith("href") and not value.startswith("data:"):
                self.references.append(value.removeprefix("#"))
            self.references += re.findall(r"url\(#([^)]*)\)", value or "")


@pytest.fixture(scope="module")
def limits():
    return {"no_fall": 0.0, "max_tilt_deg": 2.0, "min_margin_m": 0.01, "max_slip_mm": 5.0}


def content(text):
    """Return what a page's scripts read."""
    packed = re.search(r'id="data">([^<]*)<', text).group(1)
    return json.loads(gzip.decompress(base64.b64decode(packed)))


def drawn(traces, limits):
    return charts(traces, FEET, limits, moments(traces, FEET))


def page(invented, limits, ticks=400):
    traces = invented.walk(ticks)
    timings = {"walker": Timing(118.0, 900.0), "simulator": Timing(532.0, 800.0)}
    about = About("rough <terrain>", "walks & looks", 3, {"Version": "1"}, limits, FEET, timings)
    return render(about, traces, judge(traces, limits, message_hash="ab" * 32, notes=("recorder late",)))


def test_stands_alone_and_is_well_formed(invented, limits):
    text = page(invented, limits)
    assert "http" not in text.replace("http-equiv", "")
    nesting = Nesting()
    nesting.feed(text)
    assert not nesting.open
    assert set(nesting.references) <= set(nesting.ids)
    drawn = [name for name in nesting.ids if re.search(r"-[a-z]+[0-9a-f]{10}$", name)]
    assert len(drawn) == len(set(drawn))


def test_shows_verdict_plots_moments_and_events(invented, limits):
    text = page(invented, limits)
    for part in ("FAIL", "rough &lt;terrain&gt;", "walks &amp; looks", "ab" * 32, "recorder late", "step refused"):
        assert part in text
    for title in ("Way over the ground", "Height along the way", "What it decided"):
        assert title in text
    assert text.count("<svg") == 5
    titles = " ".join(chart["title"] for chart in content(text)["charts"])
    for title in ("Tilt", "margin", "Velocity forward", "Velocity error", "Odometry error", "Sliding", "NIS", "NEES"):
        assert title in titles
    assert re.search(r"data-t.*t = \d+\.\d\d s.*largest tilt", text)


def test_curves_keep_their_extremes_and_scale_to_the_data_not_to_the_limit(invented, limits):
    tilt = next(c for c in drawn(invented.walk(3000), limits) if "Tilt" in c["title"])
    (curve,) = tilt["series"]
    assert len(curve["t"]) < 1500
    assert max(curve["y"]) == pytest.approx(np.degrees(0.08), rel=1e-3)
    assert tilt["limits"] == [{"value": 2.0, "text": "limit 2 deg"}]


def test_truth_lies_over_the_estimate(invented, limits):
    velocity = next(c for c in drawn(invented.walk(400), limits) if c["title"].startswith("Velocity forward"))
    estimated, true = velocity["series"]
    assert true["name"] == "true"
    assert true["width"] < estimated["width"]


def test_consistency_names_a_filter_that_claims_too_much(invented):
    traces = invented.walk(400)
    found = {test.name: test for test in consistency(traces)}
    assert found[NIS].verdict == "consistent"
    assert found[NIS].mean == pytest.approx(1.0)
    rows = np.array(traces.rows["state/velocity"])
    rows[:, 5:8] *= 1e-2
    traces.rows["state/velocity"] = [tuple(row) for row in rows]
    assert {t.name: t for t in consistency(traces)}["NEES of the velocity, axes apart"].verdict == "overconfident"


def test_a_run_without_messages_still_has_a_report(tmp_path):
    path = write_report(tmp_path / "deep" / "report.html", About("x"), Traces(), judge(Traces(), {"no_fall": 0.0}))
    assert "FAIL" in path.read_text(encoding="utf-8")
