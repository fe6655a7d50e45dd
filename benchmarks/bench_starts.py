"""A hundred starts of the whole system over Zenoh in random order: no first message lost; and the same run each time.

Each start: a new router, one process per service in an order drawn by the number of the start, all links proved, a run
of a few ticks. A service does tick 0 only with every input that is due in it, so a service that reached the last tick
received seq 0 of every topic it declares; nothing may have been refused on the way. The recording shows seq 0 of every
declared topic once more, from outside the services. Ticks that were sent again after 0.25 s of silence are counted
apart: a busy machine is silent, too.

Then the demo five times, each with processes newly started in another order: one hash, that of the in-memory bus; and
another seed, another hash.
"""

import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from surefoot.lab.runs.local import run_local
from surefoot.record.recording import read_recording
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from tests.e2e.live import RUN_S, SERVICES, Live, wait_until
from tests.e2e.test_live import declared

STARTS, RUNS = 100, 5
TICKS = 15
SCENARIO = "rough-terrain"


def shuffled(number: int) -> list[str]:
    """Start order of a start."""
    return random.Random(number).sample(SERVICES, len(SERVICES))


def start_once(folder: Path, number: int) -> tuple[float, int, list[str]]:
    """Time from the first process to the last tick of a short run, s; ticks sent again; what was wrong."""
    wrong: list[str] = []
    again = 0
    with Live(folder, record=True) as live:
        began = time.monotonic()
        live.start(shuffled(number))
        live.reset(seed=number, max_ticks=TICKS)
        wait_until(lambda: live.supervisor.ended.is_set(), RUN_S, f"start {number} ends")
        seconds = time.monotonic() - began
        last = live.supervisor.ticks - 1
        for name in SERVICES:
            wait_until(lambda name=name: live.health(name).tick == last, RUN_S, f"{name} did the last tick")
            health = live.health(name)
            refused = {reason: n for reason, n in health.refused.items() if not reason.startswith("join_")}
            again += refused.pop("resent_ticks", 0)
            if refused:
                wrong.append(f"{name} refused {refused}")
    assert live.bag is not None
    first: dict[str, int] = {}
    for recorded in read_recording(live.bag):
        if recorded.model is not None:
            first.setdefault(recorded.key, recorded.message().seq)
    wrong += [f"{key} begins with seq {seq}" for key, seq in first.items() if seq != 0]
    wrong += [f"{key} was not received" for key in sorted(declared() - set(first))]
    return seconds, again, wrong


def main(starts: int = STARTS, runs: int = RUNS) -> None:
    """Prints what went wrong in which start, the times, and the hashes."""
    subprocess.run([sys.executable, "-m", "surefoot.lab.cli.main", "warm"], check=True, stdout=subprocess.DEVNULL)
    times: list[float] = []
    faulty = repeated = 0
    for number in range(starts):
        with tempfile.TemporaryDirectory() as name:
            seconds, again, wrong = start_once(Path(name), number)
        times.append(seconds)
        faulty += bool(wrong)
        repeated += again > 0
        for text in wrong:
            print(f"  start {number} ({' '.join(shuffled(number))}): {text}")
    if times:
        print(
            f"{starts} starts in random order: {starts - faulty} with seq 0 of every declared topic in every service; "
            f"first process to tick {TICKS - 1}: median {statistics.median(times):.2f} s, longest {max(times):.2f} s; "
            f"in {repeated} starts ticks were sent again"
        )
    scenario = load_scenario(find_scenario(SCENARIO))
    hashes: list[str] = []
    for number in range(runs):
        with tempfile.TemporaryDirectory() as name, Live(Path(name)) as live:
            live.start(shuffled(1000 + number))
            hashes.append(live.conduct(scenario).run_hash)
    if runs:
        print(f"{SCENARIO}, {runs} Zenoh runs in shuffled start order: {len(set(hashes))} hash, {hashes[0][:16]}")
        same = run_local(scenario).run_hash == hashes[0]
        print(f"  in-memory bus: {'the same' if same else 'ANOTHER'}")
        other = run_local(scenario, scenario.seed + 1).run_hash
        print(f"  seed {scenario.seed + 1}: {'another, ' + other[:16] if other != hashes[0] else 'THE SAME'}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
