"""The live view beside a walking robot: processor share, pictures a second, age of what is seen, bytes, addresses."""

import os
import tempfile
import time
from pathlib import Path
from subprocess import PIPE, STDOUT
from urllib.parse import urlsplit

import numpy as np

from benchmarks.bench import Bench, goal
from benchmarks.machine import ENTRY, up
from surefoot.bus.interface import Delivery
from surefoot.client import connect
from surefoot.errors import SurefootError
from surefoot.schemas.topics import SIM_TRUTH
from surefoot.services.supervisor.processes.process import busy_s
from tests.browser import CHROMIUM, MISSING, Browser
from tests.processes import running

BENCH = Bench("view")
READY = "document.body?.dataset.ready == '1'"
SETTLE_S = 2.0
"""Wall time before measurements begin, s."""
LONGEST_S = 600.0
"""Wall time after which a page without a picture is an error, s: kernels may have to be compiled first."""


class Arrivals:
    """Wall time at which the truth of each stamp arrived at another observer of the same system, ms since 1970."""

    def __init__(self) -> None:
        self.at: dict[float, float] = {}

    def take(self, delivery: Delivery) -> None:
        """Store the wall time at which a message of the truth arrived, by its stamp."""
        if not delivery.prime:
            self.at[round(delivery.header().stamp_ns * 1e-9, 3)] = 1000.0 * time.time()


@BENCH.part(quick="--seconds 5")
def live(seconds: float = 20.0, walk: float = 3.0) -> None:
    """Measure the live view of a walking Ragno in headless Chromium: pictures per s, their age, processor share.

    Age of a picture: from the arrival of its truth at this process, an observer beside the view, until the page has
    painted it. Processor shares are those of the process `surefoot view`.

    Args:
        seconds: wall time of each measurement.
        walk: length of the walk, m.
    """
    if CHROMIUM is None:
        raise SurefootError("not_installed", MISSING)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command = [*ENTRY, "view", "--port", "0"]
        with (
            up(folder / "state") as machine,
            running(command, env=machine.environment, stdout=PIPE, text=True) as view,
        ):
            assert view.stdout is not None
            url = view.stdout.readline().removeprefix("view: ").strip()
            time.sleep(SETTLE_S)
            rest = share_of(view.pid, seconds)
            with connect(endpoint=machine.address) as robot, Browser(folder / "profile") as browser:
                arrivals = Arrivals()
                robot.call("cmd/walk", action="walk", distance=walk)
                browser.go(url)
                browser.wait(READY)
                robot.bus.subscribe(SIM_TRUTH, arrivals.take)
                time.sleep(SETTLE_S)
                begun = browser.run("live.frames")
                share = share_of(view.pid, seconds)
                frames = browser.run("live.frames") - begun
                painted, size = browser.run("live.painted"), browser.run("JSON.stringify(live.frame).length")
                foreign = [each for each in browser.asked if urlsplit(each).hostname not in (None, "127.0.0.1")]
    ages = np.array([at - arrivals.at[t] for t, at, _ in painted if t in arrivals.at])
    print(f"load of the machine {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors, {len(ages)} pictures")
    goal("view, no page open", 100.0 * rest, unit="% of a core")
    goal("view, one page open", 100.0 * share, "<=", 8.0, "% of a core")
    goal("pictures a second in the page", frames / seconds, ">=", 20.0, "1/s")
    goal("age of a picture, median", float(np.median(ages)), unit="ms")
    goal("age of a picture, p99", float(np.percentile(ages, 99)), "<=", 50.0, "ms")
    goal("bytes of a frame", float(size))
    goal("addresses of other machines asked for", len(foreign), "<=", 0)


@BENCH.part(quick="--metres .01")
def first(metres: float = 0.05) -> None:
    """Measure the wall time from `surefoot run rough-terrain --view` to a picture of the robot after its first steps.

    Args:
        metres: way of the trunk between the first picture and that one, m.
    """
    if CHROMIUM is None:
        raise SurefootError("not_installed", MISSING)
    with tempfile.TemporaryDirectory() as name, Browser(Path(name) / "profile") as browser:
        began = time.monotonic()
        command = [*ENTRY, "run", "rough-terrain", "--view", "--out", str(Path(name) / "run")]
        with running(command, stdout=PIPE, stderr=STDOUT, text=True) as run:
            assert run.stdout is not None
            url = next(line for line in run.stdout if line.startswith("view: ")).removeprefix("view: ").strip()
            browser.go(url)
            browser.wait("window.live?.painted?.length > 0", LONGEST_S)
            standing = time.monotonic() - began
            browser.run("window.begun = live.frame.base[0]")
            browser.wait(f"live.frame.base[0] - begun > {metres}", LONGEST_S)
            walking = time.monotonic() - began
    print(f"load of the machine {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
    goal("first picture in the page", standing, unit="s")
    goal("picture of the robot after its first steps", walking, "<=", 20.0, "s")


def share_of(pid: int, seconds: float) -> float:
    """Return the processor time over wall time of a process, all its threads, during `seconds` s."""
    before, began = busy_s([pid]), time.monotonic()
    time.sleep(seconds)
    return (busy_s([pid]) - before) / (time.monotonic() - began)
