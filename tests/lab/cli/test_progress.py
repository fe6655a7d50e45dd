"""Long work states what it is within its first second, then its share and the time left, and on Ctrl-C what is kept."""

import re
import signal
import threading
from contextlib import suppress
from itertools import pairwise

import pytest

from surefoot.errors import SurefootError
from surefoot.kernels.compiling import Compiling
from surefoot.lab.cli import main as cli
from surefoot.lab.cli import progress as module
from surefoot.lab.cli.progress import EACH_S, FIRST_S, SECOND_S, Progress
from surefoot.lab.cli.run import _ProgressLine
from surefoot.lab.runs.live import RunProgress


def lines_of(seconds: float, steps: int) -> list[tuple[float, str]]:
    """Return the lines, and when they come, of even work."""
    lines, now = list[tuple[float, str]](), [100.0]
    progress = Progress("walk", report=lambda text: lines.append((now[0] - 100.0, text)), clock=lambda: now[0])
    for step in range(1, steps + 1):
        now[0] += seconds / steps
        progress.at(step / steps, "")
    return lines


def test_short_work_is_silent() -> None:
    assert lines_of(0.9 * FIRST_S, 10) == []


def test_long_work_reports_within_its_first_second_and_then_now_and_then() -> None:
    lines = lines_of(60.0, 600)
    assert lines[0][0] <= FIRST_S + 0.11
    assert lines[0][1] == "walk: 1 %, about 59 s left"
    gaps = [b[0] - a[0] for a, b in pairwise(lines)]
    assert all(SECOND_S <= gap <= EACH_S + 0.11 for gap in gaps)
    assert gaps == sorted(gaps) or max(gaps) - min(gaps[3:]) < 0.2
    for at, text in lines:
        share, left = (int(part) for part in re.findall(r"(\d+) %, about (\d+) s", text)[0])
        assert abs(0.01 * share * 60.0 - at) < 0.4
        assert abs(at + left - 60.0) < 0.6
    assert lines[-1][1].startswith("walk: 8")


def test_time_before_the_work_begins_and_that_of_compilations_are_no_measure_of_the_time_left(monkeypatch):
    """Before, ten seconds of imports and forty of a compilation counted as the work's: 3 and 4 s were left."""
    lines, now = list[str](), [0.0]
    monkeypatch.setattr(module, "COMPILING", compiling := Compiling())
    monkeypatch.setattr("surefoot.kernels.compiling.monotonic", lambda: now[0])
    progress = Progress("walk", report=lines.append, clock=lambda: now[0])
    now[0] = 10.0
    progress.at(0.0)
    now[0] = 28.0
    progress.at(0.9)
    compiling.began("f")
    now[0] = 68.0
    compiling.ended("f")
    now[0] = 69.0
    progress.at(0.95)
    assert lines == ["walk: at work for 10 s", "walk: 90 %, about 2 s left", "walk: 95 %, about 1 s left"]


def test_a_compilation_that_has_lines_of_its_own_gets_no_others(monkeypatch):
    lines, now = list[str](), [0.0]
    monkeypatch.setattr(module, "COMPILING", compiling := Compiling())
    with compiling.reporting(lambda name: None):
        progress = Progress("walk", report=lines.append, clock=lambda: now[0])
        compiling.began("f")
        for now[0] in (1.0, 20.0, 40.0):
            progress.at(0.0)
        compiling.ended("f")
        now[0] = 80.0
        progress.at(0.0)
    assert lines == ["walk: at work", "walk: at work for 80 s"]


def test_work_without_a_share_states_how_long_it_has_taken_and_finished_work_nothing() -> None:
    lines, now = list[str](), [0.0]
    progress = Progress("walk", report=lines.append, clock=lambda: now[0])
    now[0] = 1.0
    progress.at(0.0, "reading")
    now[0] = 50.0
    progress.at(0.0)
    now[0] = 99.0
    progress.at(1.0)
    assert lines == ["walk: at work (reading)", "walk: at work for 50 s"]


def test_a_part_of_the_work_fills_its_part_of_the_whole() -> None:
    lines, now = list[str](), [0.0]
    progress = Progress("walk", report=lines.append, clock=lambda: now[0])
    now[0] = 30.0
    progress.part(0.5, 0.7, "plots")(0.5)
    assert lines == ["walk: 60 %, about 20 s left (plots)"]


def test_a_step_that_says_nothing_does_not_keep_the_context_silent(monkeypatch) -> None:
    monkeypatch.setattr(module, "FIRST_S", 0.0)
    said = threading.Event()
    with Progress("walk", report=lambda text: said.set()):
        assert said.wait(20.0)


def test_ctrl_c_says_what_is_kept_and_other_ends_do_not() -> None:
    lines = list[str]()
    for end in (KeyboardInterrupt, SurefootError("invalid", "of another kind"), None):
        with suppress(KeyboardInterrupt, SurefootError), Progress("walk", "run.mcap is kept", lines.append) as progress:
            progress.at(0.4)
            if end is not None:
                raise end
    assert lines == ["walk: interrupted at 40 %; run.mcap is kept"]


def test_ctrl_c_after_a_run_names_the_recording_and_before_it_nothing(tmp_path, capsys) -> None:
    """Before, a run that was interrupted while its report was written had recorded nothing, by its last line."""
    recording = tmp_path / "run.mcap"
    recording.write_bytes(b"")
    for begun, written in ((False, recording), (True, None), (True, recording)):
        with suppress(KeyboardInterrupt), _ProgressLine("walk", quiet=False) as line:
            if begun:
                line.show(RunProgress.at(1, 1.0, 60.0, written))
            raise KeyboardInterrupt
    lines = [text for text in capsys.readouterr().err.splitlines() if "interrupted" in text]
    assert lines[0] == "walk: interrupted before the run began; nothing was recorded"
    assert lines[1] == "walk: interrupted before its report was written; nothing was recorded"
    assert lines[2].startswith(f"walk: interrupted before its report was written; {recording} is kept")


@pytest.fixture
def talkative(monkeypatch, tmp_path):
    """Every share that is stated makes a line; the working folder is empty."""
    for name in ("FIRST_S", "SECOND_S", "EACH_S"):
        monkeypatch.setattr(module, name, 0.0)
    monkeypatch.setenv("SUREFOOT_SECURITY", str(tmp_path / "security"))
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


LONG = [
    ("report {bag} -o r.html", "report of walk.mcap", "report.recorded.write_report"),
    ("why {bag}", "causes in walk.mcap", "report.why.find_outcome"),
    ("audit {bag}", "proofs of walk.mcap", "audit.walk._claim"),
    ("bisect {bag} {bag}", "comparison of {bag} and {bag}", "again.bisect._Pairing.end"),
    ("verify {bag}", "", "again.repeat.RecordedRun.again"),
    ("bag export {bag} --to csv -o c.csv", "walk.mcap to csv", "bags.exporting.table_of"),
    ("bag export {bag} --to foxglove -o f.mcap", "walk.mcap to foxglove", ""),
    ("estimate {bag} -o e", "estimate of walk.mcap", "estimation.results.track_of"),
    ("footholds gather {bag} -o g.jsonl", "g.jsonl", "footholds.campaign.append"),
    ("evaluate navigator --seeds 0:300", "300 episodes of planner", "train.evaluation.run_episodes"),
    ("train navigator -p sarsa --episodes 200 -o p.npz", "policy p.npz", "train.runs.run_episodes"),
    ("chaos stand --ticks 20", "chaos in stand", "chaos.run.Director"),
    ("reproduce wawrzynski --no-figures", "wawrzynski", "surefoot.papers.wawrzynski.velocity.findings"),
]
WITHOUT_SHARE = [
    ("map show floor.npz", "summary of floor.npz", "maps.summary.summary_of"),
    ("footholds judge ragno {bag}", "quality of ragno", "footholds.campaign.read"),
    ("bag info --verify {bag}", "checksums of walk.mcap", "surefoot.record.recording.verify_recording"),
    ("robot check ragno", "check of ragno", "surefoot.robot.kinematics.com"),
    ("robot show ragno", "ragno.png", "report.robot_drawing.draw_robot"),
    ("robot export ragno", "ragno.xml", "robots.export.write_mjcf"),
    ("robot import {bag} -o here", "import of walk.mcap", "robots.folder.import_robot"),
]
"""Commands that take seconds where nothing is compiled or cached yet, with one step only."""
COSTLY = ("report", "audit", "estimate", "evaluate", "chaos", "reproduce")
"""Commands that take seconds of processor time: they are only interrupted."""


COLD = "surefoot: compiling numeric kernels, "
"""First words where a command's kernels are compiled first: those of training are, in a fresh checkout."""


@pytest.mark.parametrize(
    ("words", "what"), [(words, what) for words, what, _ in LONG if words.split()[0] not in COSTLY and what]
)
def test_a_long_command_names_its_work_and_states_share_and_time_left(in_process, talkative, recorded, words, what):
    pytest.importorskip("foxglove", reason="pip install 'surefoot[foxglove]'") if "foxglove" in words else None
    code, _, err = in_process(*words.format(bag=recorded).split())
    assert code == 0, err
    what = what.format(bag=recorded)
    assert err.startswith((f"{what}: ", COLD))
    assert re.search(rf"^{re.escape(what)}: \d+ %, about \d+ s left", err, re.MULTILINE)


@pytest.mark.parametrize(("words", "what", "inner"), WITHOUT_SHARE)
def test_a_command_of_one_step_names_its_work(monkeypatch, in_process, talkative, recorded, words, what, inner):
    """Before, these commands were silent, for ten seconds and more where kernels are compiled on a busy machine."""
    stated, inner = threading.Event(), inner if inner.startswith("surefoot") else f"surefoot.lab.{inner}"
    monkeypatch.setattr(Progress, "_write_due", lambda self: (name(self), stated.set()))
    name = lambda self: self._report(f"{self._what}: at work")  # noqa: E731

    def wait(*_, **__):
        assert stated.wait(20.0)
        raise SurefootError("enough", "the work is named")

    monkeypatch.setattr(inner, wait)
    assert in_process(*words.format(bag=recorded).split())[2].startswith(f"{what}: at work\n")


@pytest.fixture
def default_signals():
    """SIGTERM and SIGINT are handled as in a new program: a test runner in the background of a shell ignores SIGINT."""
    defaults = {signal.SIGTERM: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    before = {number: signal.signal(number, handler) for number, handler in defaults.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("words", "inner", "number"),
    [(words, inner, signal.SIGINT) for words, _, inner in LONG + WITHOUT_SHARE if inner]
    + [(words, inner, signal.SIGTERM) for words, _, inner in LONG if words.startswith(("why", "estimate"))],
)
def test_ctrl_c_or_sigterm_in_a_long_command_ends_with_one_sentence_and_no_half_file(
    monkeypatch, in_process, talkative, recorded, default_signals, words, inner, number
):
    def stop(*_, **__):
        assert signal.getsignal(number) is signal.default_int_handler  # else it ends the test runner
        signal.raise_signal(number)

    if "wawrzynski" in words:
        monkeypatch.setattr("surefoot.papers.wawrzynski.velocity.run", lambda **_: [])
        monkeypatch.setattr("surefoot.lab.cli.warming.warm_if_cold", lambda *_: None)
    monkeypatch.setattr(inner if inner.startswith("surefoot") else f"surefoot.lab.{inner}", stop)
    code, out, err = in_process(*words.format(bag=recorded).split())
    assert (code, out) == (cli.EXIT_INTERRUPT, "")
    last = err.strip().splitlines()[-1]
    assert re.search(r": interrupted( at \d+ %)?; \w", last), err
    assert "Traceback" not in err
    left = [path.name for path in talkative.rglob("*") if path.is_file()]
    assert left == (["p.seed0.checkpoint.npz"] if "sarsa" in words else [])


def test_an_unknown_format_and_a_file_that_exists_are_refused_before_the_work_begins(in_process, talkative, recorded):
    for words in (f"{recorded} --to nonsense", f"{recorded} --to csv -o {recorded}"):
        code, _, err = in_process(*f"bag export {words}".split())
        assert code == 2
        assert err.count("\n") == 1
        assert err.startswith("surefoot: ")


def test_a_name_with_the_end_of_a_line_is_one_line() -> None:
    lines = list[str]()
    with suppress(KeyboardInterrupt), Progress("report of a\udc80\nb.mcap", report=lines.append):
        raise KeyboardInterrupt
    assert lines == [r"report of a\udc80\nb.mcap: interrupted; nothing was written"]


def test_a_recording_that_is_viewed_states_share_and_time_left(in_process, talkative, recorded):
    """Before, `view` was silent for as long as its report took, after one line."""
    code, _, err = in_process(*f"view {recorded} --port 0 --duration 0.01".split())
    assert code == 0, err
    assert re.search(r"^reading .*: \d+ %, about \d+ s left", err, re.MULTILINE)
