"""Trials with ground primitives by simulators over the network: two beside one, and one of two killed in the middle.

    python -m benchmarks.bench_trials --trials 40

A router on the loopback interface, simulators in processes of their own. The campaign runs with one worker, with two,
and again with two of which one is killed after a quarter of the trials; the bins of all three must be equal. The ratio
of trials per second needs two idle cores: the load of the machine is printed with it.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lab.footholds.campaign import read
from surefoot.lab.footholds.primitives import paper_trials, run_trials
from surefoot.lab.footholds.workers import remote_workers
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import PrimitiveTrial
from surefoot.services.footholds.learning.samples import gather
from surefoot.services.footholds.models.lattice import Bins, Lattice, filled

START_S = 300.0


def port() -> int:
    """A free port of the loopback interface."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def simulator(folder: Path, endpoint: str, namespace: str) -> subprocess.Popen[bytes]:
    """Start a simulator that waits for trials."""
    words = ["-m", "surefoot.lockstep.discover", "simulator", "--connect", endpoint, "--namespace", namespace]
    kept = {key: value for key, value in os.environ.items() if not key.startswith("SUREFOOT_")}
    with (folder / f"{namespace.replace('/', '-')}.log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, *words], stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, cwd=folder,
            env={**kept, "SUREFOOT_SIMULATOR_AUTOSTART": "false", "XDG_STATE_HOME": str(folder / "state")},
            start_new_session=True,
        )  # fmt: skip


def answers(place: str, folder: Path) -> None:
    """Wait until a simulator answers a trial."""
    until = time.monotonic() + START_S
    while True:
        with remote_workers([place], 20.0) as (worker,):
            try:
                run_trials(
                    load_robot("ragno"),
                    [PrimitiveTrial(primitive="flat")],
                    folder / f"first-{time.monotonic_ns()}",
                    [worker],
                )
                return
            except Exception as error:
                if time.monotonic() > until:
                    raise SystemExit(f"{place} does not answer: {error}") from None
                time.sleep(0.5)


def bins(path: Path) -> Bins:
    """The bins of a file of samples."""
    found = gather(read(path)[0])
    return filled(Lattice(), found.x, found.r)


def campaign(
    trials: list[PrimitiveTrial], out: Path, places: list[str], show: Callable[[str, int], None] = lambda n, c: None
) -> float:
    """Run a campaign; returns trials per second."""
    began = time.perf_counter()
    with remote_workers(places, 20.0) as workers:
        run_trials(load_robot("ragno"), trials, out, workers, show)
    return len(trials) / (time.perf_counter() - began)


def main() -> None:
    """Print rates, their ratio, and whether the bins are the same."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=60)
    count = parser.parse_args().trials
    trials = (paper_trials() + paper_trials(noise=0.003, seeds=(1, 2, 3)))[:count]
    endpoint = f"tcp/127.0.0.1:{port()}"
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        router = ZenohBus(ZenohOptions("router", (), (endpoint,), "trials/router"))
        stack.callback(router.close)
        spaces = ["trials/one", "trials/two"]
        processes = [simulator(folder, endpoint, space) for space in spaces]
        for process in processes:
            stack.callback(process.wait)
            stack.callback(process.kill)
        places = [f"{space}@{endpoint}" for space in spaces]
        for place in places:
            answers(place, folder)
        one = campaign(trials, folder / "one.jsonl", places[:1])
        two = campaign(trials, folder / "two.jsonl", places)
        done: list[str] = []

        def show(name: str, samples: int) -> None:
            done.append(name)
            if len(done) == max(1, count // 4):
                processes[1].send_signal(signal.SIGKILL)

        campaign(trials, folder / "killed.jsonl", places, show)
        same = bins(folder / "one.jsonl") == bins(folder / "two.jsonl") == bins(folder / "killed.jsonl")
        load = os.getloadavg()[0]
        print(f"{count} trials: one worker {one:.2f} a second, two {two:.2f} = {two / one:.2f}x (load {load:.1f})")
        print(f"one of two killed after {max(1, count // 4)} trials: bins {'the same' if same else 'DIFFERENT'}")
    if not same:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
