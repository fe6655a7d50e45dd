"""``docs/extending.md`` works as it stands: its files are put into a copy of the tree, checked and run there."""

import json
import os
import re
import shutil
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.local import node_of
from tests.processes import end_process, run_process, start_process
from tests.surefoot.net import WAIT_S, Net
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyWalker

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "extending.md"
BLOCK = re.compile(r"^```\w+ (.+?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
WORD = re.compile(r'(\w+)=("[^"]*"|\S+)')
ENOUGH_TICKS = 40
START_S = 240.0  # s wall, a cold process on a busy machine

pytestmark = pytest.mark.e2e


def blocks() -> list[tuple[dict[str, str], str]]:
    """The files of the page: what to do with each, and its text."""
    found = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    return [({key: value.strip('"') for key, value in WORD.findall(words)}, text) for words, text in found]


def apply(tree: Path, words: dict[str, str], text: str) -> None:
    """Do with one block what the page states."""
    if "append" in words:
        with (tree / words["append"]).open("a", encoding="utf-8") as file:
            file.write(text)
    elif "before" in words:
        path = tree / words["in"]
        head, mark, tail = path.read_text(encoding="utf-8").partition(words["before"])
        assert mark, words
        path.write_text(f"{head.rstrip()}\n{text}\n{mark}{tail}", encoding="utf-8")
    else:
        path = tree / words["file"]
        path.parent.mkdir(exist_ok=True)
        if "from" in words:
            old, new = Path(words["from"]).stem, path.stem
            copied = (tree / words["from"]).read_text(encoding="utf-8")
            text = (
                copied.replace(f"name: {old}\n", f"name: {new}\n").replace(f"supervise {old}", f"supervise {new}")
                + text
            )
        path.write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the checkout with everything the page adds."""
    copy = tmp_path_factory.mktemp("extended")
    for folder in ("schemas", "surefoot", "services", "lab", "papers", "compose", "scenarios", "tests", "docs"):
        shutil.copytree(ROOT / folder, copy / folder, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", copy)
    for words, text in blocks():
        apply(copy, words, text)
    (copy / "services" / "odometer" / "__init__.py").touch()
    return copy


def command(tree: Path, *words: str) -> dict[str, Any]:
    """Return the command that runs Python in the copy."""
    return {
        "command": [sys.executable, *words],
        "cwd": tree,
        "env": {**os.environ, "PYTHONPATH": str(tree)},
        "text": True,
    }


def run(tree: Path, *words: str) -> str:
    done = run_process(**command(tree, *words), capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_page_has_all_files() -> None:
    named = {words.get("file") or words.get("append") or words["in"] for words, _ in blocks()}
    assert {"schemas/state.py", "schemas/topics.py", "services/odometer/service.py", "scenarios/odometer.toml"} < named


def test_tables_command_line_and_tests_take_it_up(tree: Path) -> None:
    run(tree, "-m", "tests.contract.published")
    assert "published by odometer" in run(tree, "-m", "surefoot.lab.cli.main", "topic", "info", "state/way")
    assert "recorder" in next(
        line for line in run(tree, "-m", "surefoot.lab.cli.main", "graph").splitlines() if "state/way" in line
    )
    contracts = [f"tests/contract/test_{name}.py" for name in ("services", "compose", "scenarios", "schema_compat")]
    run(tree, "-m", "pytest", *contracts, "tests/services/odometer")


def test_runs_as_a_process_over_zenoh(tree: Path) -> None:
    net = Net()
    driver, config = ToyDriver(), ServiceConfig()
    nodes = [node_of(service, net.open()) for service in (driver, ToyEstimator(config), ToyWalker(config))]
    heard: list[dict[str, Any]] = []
    options = ("--connect", net.address, "--namespace", net.namespace)
    process = start_process(**command(tree, "-m", "surefoot.lockstep.discover", "odometer", *options))
    threads: list[threading.Thread] = []
    try:
        with net.plain() as onlooker:
            sink = onlooker.declare_subscriber(
                f"{net.namespace}/state/way",
                lambda sample: heard.append(json.loads(sample.payload.to_bytes() or b"{}")),
            )
            for node in nodes:
                node.start()
                if isinstance(node, DriverNode):
                    node.begin(("estimator", "walker", "odometer"), "lockstep", 0.0, 1, "hold", 0)
                threads.append(threading.Thread(target=node.run, daemon=True))
                threads[-1].start()
            deadline = time.monotonic() + START_S
            while not (heard and heard[-1].get("tick", 0) >= ENOUGH_TICKS):  # an observer may miss any of them
                assert process.poll() is None
                assert time.monotonic() < deadline, (driver.node.leader, heard[-1:])
                threading.Event().wait(0.01)
            sink.undeclare()
        last = heard[-1]
        speeds = [0.5 * abs(x) for x in (0.0, *driver.history[: last["tick"]])]
        assert last["distance"] == pytest.approx(0.01 * sum(speeds))
        assert last["source"] == "odometer"
    finally:
        for node in nodes:
            node.stop()
        for thread in threads:
            thread.join(WAIT_S)
        end_process(process)
        net.close()
    assert process.returncode == 0
