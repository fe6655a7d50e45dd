"""Commands between backticks of the pages: each whole one is executed as it stands, here or by a test that is named.

Those that are quick and need no system are executed by `tests/contract/test_pages_commands.py`, those of the cheat
sheet by `test_cheat_sheet.py`, blocks of commands by `test_pages.py`. A word of a page that is a placeholder, as FILE,
or a command without what it needs, as `surefoot map build`, names a command and is none.
"""

import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from tests.contract.test_docs import PAGES
from tests.contract.test_pages_commands import QUICK, commands, written
from tests.e2e.guide import Guide
from tests.e2e.live import ROOT
from tests.e2e.test_cheat_sheet import COMMANDS
from tests.expected_features import PAGE, features
from tests.processes import end_systems, run_process

pytestmark = pytest.mark.e2e

PLACEHOLDER = re.compile(r"(.*/)?[A-Z][A-Z0-9]*(\.\w+)?|.*[<>|\[\]].*|.*\.\.\.")
FILES = (
    "evaluate navigator", "evaluate navigator --params paper-arcs --policy planner --set sight.moving_match_share=1",
    "render run.mcap -o docs/walk.webp --width 720 --fps 8 --speed 3 --quality 25",
    "estimate run.mcap --estimator ekf", "run crawl-flat", "run ragno-goal", "run ragno-own-map", "chaos flat --seed 0",
)  # fmt: skip
"""Commands that take a minute or so, executed here in a folder with a recording, in this order."""
SYSTEM = ("up -d", "logs", "sim status", "sim fault sensor_stuck --target imu", "down ragno")
"""Commands that start, use and end a system, executed here in this order."""
CAMPAIGN, GOES_ON = "walks of minutes, or files that they make", "goes on until Ctrl-C, as"
ELSEWHERE = {
    "bag import walk/ --robot ./go2": ("needs a bag and a robot", "tests/e2e/test_guides.py"),
    "call cmd/walk": ("names a call, which is refused without its field", "tests/e2e/test_cheat_sheet.py"),
    "chaos flat --zenoh --seed 300 --events 10 --runs 5": ("five live walks", "tests/lab/chaos/test_live.py"),
    **{
        f"evaluate navigator --params {name} --seeds 0:{count} --json": (
            "figures of measured.md, which `python -m benchmarks report --every` compares",
            "tests/lab/cli/test_train_evaluate.py",
        )
        for name, count in (("nao", 600), ("nao-paper", 600), ("paper", 2000), ("paper-blur", 2000))
    },
    **{
        f"footholds {words}": (CAMPAIGN, f"tests/lab/{place}.py")
        for words, place in {
            "collect --out samples.jsonl": "footholds/test_pipeline",
            "learn samples.jsonl --out m.json": "footholds/test_pipeline",
            "learn samples.jsonl --out ragno.json --title ragno": "footholds/test_pipeline",
            "judge m.json others.jsonl": "cli/test_footholds", "merge a.json b.json --out c.json": "cli/test_footholds",
            "score map.asc --model m.json --out scored.npz": "cli/test_footholds", "show m.json": "cli/test_footholds",
            "primitives --out trials.jsonl": "footholds/test_primitives", "tune m.json": "cli/test_footholds",
        }.items()
    },
    **dict.fromkeys(
        ("reproduce osswald", "reproduce walas-footholds", "reproduce wawrzynski"),
        ("minutes", "tests/papers/test_reproduce.py"),
    ),
    **dict.fromkeys(("goal pause", "goal resume"), ("need a goal under way", "tests/lab/cli/test_goal.py")),
    "run examples/vision/nao-eyes.toml --seed 30": ("a block of vision.md", "tests/e2e/test_pages.py"),
    "run rough-terrain --view": (f"{GOES_ON} `run flat --view` of view.md", "tests/e2e/test_pages.py"),
    "run stand --seed 3 --out first": ("begins the features", "tests/expected_features.py"),
    **dict.fromkeys(
        ("topic echo state/landmarks", "topic echo state/velocity/ekf --plot velocity"),
        (f"{GOES_ON} `topic echo state/velocity`", "tests/e2e/test_cheat_sheet.py"),
    ),
    **dict.fromkeys(("up", "up ragno", "up --view"), (f"{GOES_ON} `up -d` does not", "tests/e2e/test_pages.py")),
    "up --listen tcp/10.0.0.7:7447": ("an address of another network", "tests/e2e/test_hosts.py"),
    "up --secure": ("a block of security.md", "tests/e2e/test_pages.py"),
    "up examples/robot/system.yaml": ("a system of a user", "tests/e2e/test_own_robot.py"),
    "verify": ("the public list takes ten minutes", "tests/lab/again/test_public.py"),
    "view run.mcap": (f"{GOES_ON} `view`", "tests/e2e/test_cheat_sheet.py"),
    **dict.fromkeys(("warm", "warm --all", "warm --force"), ("compiles for minutes; begins `make test`", "Makefile")),
}  # fmt: skip
"""Whole commands that are not executed here, why, and what executes them or their like."""
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def is_whole(words: Sequence[str]) -> bool:
    """Return True if the words are a command with all that it needs and no placeholder."""
    command, rest = commands(), list(words)
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.commands[rest.pop(0)]
    if hasattr(command, "commands") or any(PLACEHOLDER.fullmatch(word) for word in words):
        return False
    try:
        command.make_context("surefoot", rest)
    except Exception:  # an argument or the value of an option is missing
        return False
    return True


def joined(line: str) -> str:
    return shlex.join(shlex.split(line, comments=True)[1:])


def whole() -> set[str]:
    """Return the whole commands between backticks of the pages."""
    texts = (path.read_text(encoding="utf-8") for path in PAGES)
    return {shlex.join(words) for text in texts for words in written(text) if is_whole(words)}


def lines(words: tuple[str, ...]) -> list[str]:
    return [f"surefoot {each}" for each in words]


@pytest.fixture
def guide(tmp_path: Path) -> Iterator[Guide]:
    yield Guide(tmp_path)
    end_systems(tmp_path / "state" / "surefoot")


def test_each_whole_command_of_a_page_is_executed() -> None:
    shown = {joined(line) for row in features(PAGE.read_text(encoding="utf-8")) for line in row.commands}
    quick = {each for each in whole() if QUICK.fullmatch(each)}
    done = quick | {joined(each) for each in COMMANDS} | shown
    rest = whole() - done
    assert rest == {*FILES, *SYSTEM, *ELSEWHERE} - done
    assert not ELSEWHERE.keys() & done
    for reason, place in ELSEWHERE.values():
        assert reason
        assert (ROOT / place).is_file(), place


def test_names_and_placeholders_are_no_commands() -> None:
    named = ("map build", "call KEY JSON", "bag info FILE", "stop <system>", "estimate -o", "run D1", "bridge")
    assert [each for each in named if is_whole(each.split())] == []
    assert is_whole(["sim", "status"])


@pytest.mark.slow
def test_commands_that_need_files_work_as_they_stand(guide: Guide) -> None:
    run_local(replace(load_scenario("flat"), max_duration_s=8.0), recording=guide.folder / "run.mcap")
    (guide.folder / "docs").mkdir()
    guide.run(lines(FILES), 1500.0)


@pytest.mark.slow
def test_commands_that_need_a_system_work_as_they_stand(guide: Guide) -> None:
    guide.run(lines(SYSTEM))


@pytest.mark.slow
def test_every_feature_that_people_expect_works() -> None:
    done = run_process(
        [sys.executable, "-m", "tests.expected_features"], cwd=ROOT, capture_output=True, text=True, timeout=1500.0
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(done.stdout.splitlines()) == 1 + len(list(features(PAGE.read_text(encoding="utf-8"))))


def test_the_blocks_of_the_readme_work_as_they_stand(guide: Guide) -> None:
    blocks = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert [kind for kind, _ in blocks] == ["", "", "python", "python"]
    (_, made), (_, start), (_, request), (_, library) = blocks
    assert re.findall(r"^make (\w+)", made, re.MULTILINE) == ["demo", "test"]  # set-up from a registry; all tests
    demo = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ndemo:")[2].partition("\n\n")[0]
    assert "surefoot run rough-terrain\n" in f"{demo}\n"  # tests/lab/runs/test_shipped_scenarios.py
    activate = guide.folder / ".venv" / "bin" / "activate"
    activate.parent.mkdir(parents=True)
    activate.touch()  # the interpreter of these tests is at work already
    (guide.folder / "request.py").write_text(request.replace("tcp/127.0.0.1:7447", guide.address))
    (guide.folder / "library.py").write_text(library)
    shown = guide.run([*start.splitlines(), "python request.py", "python library.py", "surefoot down ragno"])
    assert '"stable"' in shown
    assert re.search(r"^0\.0\d+$", shown, re.MULTILINE)
