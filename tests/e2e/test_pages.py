"""Blocks of commands on the pages, executed as they stand in a folder with the files that they name.

Each block is executed here or by the test that `ELSEWHERE` names; `NOWHERE` states why one is not.
"""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from tests.e2e.guide import BLOCK, Guide
from tests.e2e.live import ROOT
from tests.ports import free_address
from tests.processes import end_systems

pytestmark = pytest.mark.e2e

HERE = {
    "accidents.md": (0, 1, 2, 3), "bipeds.md": (0,), "faults.md": (0,), "navigator.md": (0, 2), "security.md": (0,),
    "systems.md": (0,), "view.md": (0, 2), "vision.md": (0,),
}  # fmt: skip
"""Numbers of the blocks of each page that are executed here, in this order in one folder."""
ELSEWHERE = {
    ("afternoon.md", 0): "tests/e2e/test_guides.py::test_a_simulated_quadruped",
    ("afternoon.md", 1): "tests/e2e/test_guides.py::test_a_simulated_quadruped",
    ("afternoon.md", 2): "tests/e2e/test_guides.py::test_a_simulated_quadruped",
    ("logs.md", 0): "tests/e2e/test_guides.py::test_a_log_and_nothing_else",
    ("own-driver.md", 0): "tests/e2e/test_guides.py::test_a_model_and_controller_of_ones_own",
    ("own-driver.md", 1): "tests/e2e/test_guides.py::test_a_gait_of_ones_own",
    ("ros2.md", 0): "tests/e2e/test_guides.py::test_a_robot_on_ros_2",
    ("unitree.md", 0): "tests/e2e/test_guides.py::test_a_go2_over_dds",
}
"""Tests that execute a block of a page, by page and number of the block."""
NOWHERE = {
    ("robots.md", 0): "packages that fetch robots from the internet at first use",
    ("robots.md", 1): "commands of afternoon.md",
    ("ros2.md", 1): "options of a bridge, which tests/lab/cli/test_bridge_names.py takes apart",
}
"""Blocks that are executed nowhere as they stand, and why."""
LEFT_OUT = {
    "surefoot verify": "the public list takes ten minutes: tests/lab/again/test_public.py",
    "python -m benchmarks biped ": "a hundred walks: tests/benchmarks/test_benchmarks.py",
}
"""Commands, or beginnings of them, that are not executed here, and what executes their like."""
ENDLESS = ("surefoot view", "surefoot topic echo", "surefoot bridge", "surefoot run flat --view")
"""Beginnings of commands that go on until Ctrl-C, which comes after `SHOWN_S`, s."""
SHOWN_S = 20
BLOCK_S = 1500.0
"""Limit on the time of a block, s wall."""
AROUND = {
    ("accidents.md", 1): ("mkdir ring; cd ring", "ls run-limps.mcap; surefoot down ragno; cd .."),
    ("navigator.md", 0): ("", 'cp "$(ls -t runs/*/run.mcap | head -1)" run.mcap; surefoot down nao-goal'),
    ("view.md", 2): ("surefoot up ragno -d", ""),
}
"""Lines of the shell before and after a block: what a user of several blocks does between them."""


def blocks(page: str) -> list[str]:
    """Return the blocks of a page that have commands of the project, by number; others are empty."""
    found = BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))
    return [block if "surefoot " in block and "->" not in block else "" for block in found]


def executable(line: str) -> str:
    """Return a line of a page as it is given to the shell; empty: it is left out."""
    words = line.partition("#")[0].strip()
    if any(words == each or (each.endswith(" ") and words.startswith(each)) for each in LEFT_OUT):
        return ""
    if words.startswith(ENDLESS):
        shell = f'timeout --preserve-status -s INT {SHOWN_S} "$PYTHON" -m surefoot.lab.cli.main'
        return f"{shell} {words.removeprefix('surefoot ')} || test $? = 130"
    if "surefoot up " in words and " -d" not in words:
        return f"{words} -d"  # the page has another shell for what comes next
    return words


@pytest.fixture
def guide(tmp_path: Path) -> Iterator[Guide]:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    shutil.copy(find_scenario("flat"), tmp_path / "my-walk.toml")
    yield Guide(tmp_path)
    end_systems(tmp_path / "state" / "surefoot")


def test_each_block_is_executed_here_or_elsewhere() -> None:
    full = {
        (path.name, k) for path in (ROOT / "docs").glob("*.md") for k, block in enumerate(blocks(path.name)) if block
    }
    here = {(page, block) for page, numbers in HERE.items() for block in numbers}
    assert full == here | ELSEWHERE.keys() | NOWHERE.keys()
    for (page, _), place in ELSEWHERE.items():
        file, _, test = place.partition("::")
        body = (ROOT / file).read_text(encoding="utf-8").partition(f"def {test}(")[2].partition("\ndef ")[0]
        assert f'guide.commands("{page}"' in body, place
    for text in LEFT_OUT.values():
        assert (ROOT / text.rpartition(" ")[2]).exists(), text


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(HERE))
def test_the_blocks_of_a_page_work_as_they_stand(page: str, guide: Guide) -> None:
    if page == "security.md":
        pytest.importorskip("cryptography")
    if page == "view.md":
        pytest.importorskip("foxglove")
    if page in ("accidents.md", "view.md"):
        scenario = replace(load_scenario(find_scenario("flat")), max_duration_s=20.0)
        run_local(scenario, recording=guide.folder / "run.mcap")
        for name in ("a.mcap", "b.mcap"):
            shutil.copy(guide.folder / "run.mcap", guide.folder / name)
    others = {"tcp/127.0.0.1:7448": free_address(), "run.mcap ...": "run.mcap", "RUN.mcap ...": "runs/*/run.mcap"}
    for block in HERE[page]:
        before, after = AROUND.get((page, block), ("", ""))
        lines = [before, *map(executable, guide.commands(page, block, others)), after]
        guide.run([line for line in lines if line], BLOCK_S)
