"""Figures of the pages: found with their commands, compared as rounded; those of README stand in the rows it links."""

import re
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from subprocess import CalledProcessError, Popen, TimeoutExpired

import pytest

from benchmarks import report
from benchmarks.report import (
    LONGER,
    MACHINE,
    NUMBER,
    PAGES,
    REPEATED,
    ROOT,
    SHORT,
    Figure,
    Outputs,
    absent,
    astray,
    figures,
    missing,
    numbers,
    obstacle,
    output_of,
    repeats,
)
from tests.processes import run_process

PAGE = """# Page
Ten walks. `studies flat 0:10`

| what | figure | goal |
|---|---|---|
| way | 1.25 mm (0.9 to 2) | 3 mm |

| what | figure | seeds | command |
|---|---|---|---|
| margin | 62 mm | 0:100 | `studies rough-terrain 0:100` |
| runs | 10 000 of 10 000 | 0:100 | |
| no command but words | 7 | | `a word` |
"""


def test_rows_belong_to_their_command_or_the_one_above(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(PAGE)
    found = [(row.what, row.text, row.command) for row in figures(("page.md",), tmp_path)]
    assert found == [
        ("way", "1.25 mm (0.9 to 2)", "studies flat 0:10"),
        ("margin", "62 mm", "studies rough-terrain 0:100"),
        ("runs", "10 000 of 10 000", "studies rough-terrain 0:100"),
        ("no command but words", "7", "studies rough-terrain 0:100"),
    ]


def test_a_command_may_be_written_in_full(tmp_path: Path) -> None:
    page = PAGE.replace("`studies flat", "`python -m benchmarks studies flat").replace(
        "`a word`", "`python -m tests.a`"
    )
    (tmp_path / "page.md").write_text(page)
    found = [row.command for row in figures(("page.md",), tmp_path)]
    assert found[0] == "studies flat 0:10"
    assert found[-1] == "python -m tests.a"


def test_tables_under_a_command_of_the_pages_have_it() -> None:
    found = {(row.page, row.command) for row in figures()}
    assert {
        ("docs/measured.md", "own_map"), ("docs/measured.md", "python -m tests.mutants"),
        ("docs/estimator.md", "foreign"), ("docs/bipeds.md", "biped nao --seeds 0:100"),
    } <= found  # fmt: skip


def test_numbers_carry_their_last_digit_and_unit() -> None:
    found = numbers("0.32 % (1.4e-3), 10 000 runs, 62 mm, 5c7c9f3, 40:46")
    assert [(each.value, each.half, each.scale) for each in found[:4]] == [
        (0.32, pytest.approx(0.005), 100.0), (0.0014, pytest.approx(5e-5), 1.0), (10_000.0, 0.5, 1.0), (62.0, 0.5, 1e3),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("stated", "printed", "absent"),
    [
        ("62 mm", "margin 0.0618 m", ()),
        ("62 mm", "margin 61.9", ()),
        ("62 mm", "margin 0.047 m", ("62",)),
        ("0.32 % (1.4 %)", "odometry 0.00322, worst 0.0141", ()),
        ("0.32 % (1.4 %)", "odometry 0.00322, worst 0.0161", ("1.4",)),
        ("100 of 100", "99 of 100 passed", ("100 of 100",)),
        ("10 000 of 10 000", "reached 10000 of 10000", ()),
        ("19 of 20", "4 of 4, 19, 20", ()),
        ("10 000 sets", "10000 sets", ()),
        ("none", "3 wrong", ()),
        ("20 of 20", "20 of 20, hash 7e4096f1, -9e-512", ()),
    ],
)
def test_a_number_that_is_not_printed_is_named(stated: str, printed: str, absent: tuple[str, ...]) -> None:
    assert missing(stated, printed) == absent


def test_peers_that_were_left_out_are_named():
    assert absent("cvxpy: absent (not installed), skipped\n3 contacts\nhpp is not installed: no ratio\n") == (
        "cvxpy",
        "hpp",
    )


def test_prose_parts_a_command_from_a_table_further_down(tmp_path: Path) -> None:
    head, command, rest = PAGE.partition("Ten walks. `studies flat 0:10`\n")
    (tmp_path / "page.md").write_text(f"{head}{command}\nAnother matter.\n{rest}")
    assert "way" not in [row.what for row in figures(("page.md",), tmp_path)]


def test_figures_of_logs_that_are_absent_are_no_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    row = Figure("docs/estimator.md", "a", "3 cm", "foreign")
    monkeypatch.setattr(report, "figures", lambda *_: [row])
    monkeypatch.setattr(report, "REPEATING", ())
    for output, code in (("go1: skipped, no file go1.npz\nb: skipped, c.npz: no such file", 0), ("go1: 2 cm", 1)):
        monkeypatch.setattr(report, "output_of", lambda *_, text=output: text)
        with pytest.raises(SystemExit) if code else nullcontext():
            report.report(check=True, every=True)


def test_short_commands_are_on_the_pages_and_need_nothing() -> None:
    stated = {row.command for row in figures()}
    assert {*SHORT, *LONGER} <= stated
    assert not any(map(obstacle, (*SHORT, *LONGER)))
    assert obstacle("starts warm --against DIR")
    assert obstacle("surefoot footholds judge ragno F")
    assert all(map(obstacle, (row.command for row in figures() if re.match("surefoot (render|estimate)", row.command))))
    assert not obstacle("trials pairs --seeds 300:310 --results F")
    assert len(stated) > 60
    assert {row.page for row in figures()} <= set(PAGES)


DEMO = """
contact sliding per stance, mean             0.17 mm     none
contact sliding per stance, worst            0.85 mm     none
velocity error against truth, RMS         0.0037 m/s   <= 0.1  ok
odometry error at the end, horizontal        0.004 m   <= 0.3  ok
odometry error per way walked                  0.2 %     none
largest tilt                                 0.4 deg    <= 25  ok
smallest static margin, planned CoM         0.0503 m  >= 0.03  ok
smallest static margin, measured CoM        0.0444 m     none
"""
"""Lines that `surefoot run rough-terrain` prints."""


@pytest.mark.parametrize("wrong", ["", "50 mm", "44 mm", "3.7 mm/s", "0.2 %", "0.4 deg", "0.85 mm"])
def test_a_wrong_figure_of_the_demo_is_an_error(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [row for row in figures() if row.command == "surefoot run rough-terrain"]
    assert any(wrong in row.text for row in rows)
    if wrong:
        rows = [row._replace(text=row.text.replace(wrong, "62 " + wrong.partition(" ")[2])) for row in rows]
    monkeypatch.setattr(report, "figures", lambda *_: rows)
    monkeypatch.setattr(report, "output_of", lambda *_: DEMO)
    monkeypatch.setattr(report, "REPEATING", ())
    if not wrong:
        report.report(check=True, every=True)
        return
    with pytest.raises(SystemExit) as ended:
        report.report(check=True, every=True)
    assert ended.value.code == 1


def test_figures_of_the_readme_stand_in_the_rows_that_it_links() -> None:
    assert len(repeats("README.md")) >= 9
    assert list(astray("README.md")) == []
    text = re.sub(r"^```.*?^```$|`[^`\n]*`", "", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.M | re.S)
    others = set(NUMBER.findall(re.sub(r"\]\([^)]*\)", "", REPEATED.sub("", text))))
    assert others - {"3.11", "2", "64", "2.0"} == {"60"}  # in names: Python, ROS 2, Go2, x86-64, Apache
    assert len((ROOT / "examples" / "robot" / "driver.py").read_text(encoding="utf-8").splitlines()) == 60


@pytest.mark.parametrize(
    ("text", "section", "what"),
    [("63 mm", "page", "margin"), ("62 mm", "page", "runs"), ("62 mm", "other", "margin"), ("1.25 mm", "page", "x")],
)
def test_a_link_to_another_figure_is_an_error(
    text: str, section: str, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "page.md").write_text(PAGE)
    links = tmp_path / "README.md"
    links.write_text('[62 mm](page.md#page "margin")')
    assert repeats("README.md", tmp_path)
    assert list(astray("README.md", tmp_path)) == []
    links.write_text(f'[{text}](page.md#{section} "{what}")')
    monkeypatch.setattr(report, "REPEATING", (str(links),))
    with pytest.raises(SystemExit):
        report.report(only="none of the commands")


@pytest.mark.timeout(1200)
def test_the_figures_of_short_commands_are_those_of_the_pages() -> None:
    command = [sys.executable, "-m", "benchmarks", "report", "--check"]
    done = run_process(command, cwd=ROOT, timeout=1000, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(" rows\n") == len(SHORT)


ENDS_WHAT_IT_STARTED = """
import pathlib, signal, sys
try:
    print("started", flush=True)
    signal.pause()
finally:
    pathlib.Path(sys.argv[1]).touch()
"""


IGNORES_INTERRUPTS = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
print("started", flush=True)
signal.pause()
"""


Check = Callable[[list[str], BaseException], None]


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> Check:
    """Check a command whose first wait ends with an error."""

    def run(words: list[str], error: BaseException) -> None:
        communicate, begun = Popen.communicate, list[bool]()

        def first(process: Popen[str], input: str | None = None, timeout: float | None = None) -> tuple[str, str]:
            if begun:
                return communicate(process, input, timeout)
            begun.append(True)
            assert process.stdout is not None
            assert process.stdout.readline() == "started\n"
            raise error

        monkeypatch.setattr("benchmarks.report._argv", lambda command: [sys.executable, "-c", *words])
        monkeypatch.setattr(Popen, "communicate", first)
        with pytest.raises(type(error)):
            output_of("soak stops", 1.0)

    return run


@pytest.mark.parametrize("written", [0, 1_000_000])
def test_a_command_that_takes_too_long_ends_what_it_started(tmp_path: Path, interrupted: Check, written: int):
    script = ENDS_WHAT_IT_STARTED.replace("finally:", f"finally:\n    print(' ' * {written}, flush=True)")
    interrupted([script, str(tmp_path / "ended")], TimeoutExpired("soak stops", 1.0))
    assert (tmp_path / "ended").exists()


def test_an_interrupt_is_kept_where_the_command_ignores_it(monkeypatch: pytest.MonkeyPatch, interrupted: Check):
    monkeypatch.setattr("benchmarks.report.GRACE_S", 0.05)
    interrupted([IGNORES_INTERRUPTS], KeyboardInterrupt())


def test_short_commands_print_no_times():
    assert not any(map(MACHINE.match, (*SHORT, *LONGER)))
    assert not MACHINE.match("surefoot run rough-terrain")
    assert MACHINE.match("navigator environments")


def test_a_kept_output_is_compared_again_but_its_command_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    run = list[tuple[str, float]]()

    def output(command: str, limit_s: float, folder: Path | None) -> str:
        run.append((command, limit_s))
        if command == "fails":
            raise CalledProcessError(3, command, "", "no robot")
        if limit_s < 100.0:
            raise TimeoutExpired(command, limit_s)
        return "margin 0.0618 m"

    monkeypatch.setattr(report, "output_of", output)
    results = tmp_path / "outputs.jsonl"
    assert Outputs(results, 50.0).of("long") == (None, "takes more than 50 s")
    assert Outputs(results, 20.0).of("long") == (None, "takes more than 50 s")
    assert Outputs(results, 200.0).of("long") == ("margin 0.0618 m", "")
    assert Outputs(results, 20.0).of("long") == ("margin 0.0618 m", "")
    assert run == [("long", 50.0), ("long", 200.0)]
    for _ in range(2):
        assert Outputs(results).of("fails") == (None, "ends with 3: no robot")
    assert len(run) == 4


def test_a_command_makes_its_results_file_in_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    words = ["-c", "import sys; print(sys.argv[-1])", "--results", "F"]
    monkeypatch.setattr(report, "_argv", lambda command: [sys.executable, *words])
    assert Path(output_of("trials --results F", folder=tmp_path).strip()).parent == tmp_path
