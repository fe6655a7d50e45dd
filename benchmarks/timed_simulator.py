"""The simulator's process, with a clock on its physics: started by `bench_simulator` in the place of the simulator."""

import json
import os
import time
from pathlib import Path

from surefoot.services.simulator.service import Simulator
from surefoot.services.simulator.world import PhysicsWorld

spent = 0.0
_run_to = PhysicsWorld._run_to  # pyright: ignore[reportPrivateUsage]


def timed(self: PhysicsWorld, step: int) -> None:
    """Physics steps, their CPU time booked."""
    global spent
    began = time.thread_time()
    _run_to(self, step)
    spent += time.thread_time() - began


class TimedSimulator(Simulator):
    """Says at its end what its physics cost."""

    def on_stop(self) -> None:
        """Write s of CPU and ticks."""
        Path(os.environ["SUREFOOT_BENCH_FILE"]).write_text(json.dumps([spent, self.world.tick]))


if __name__ == "__main__":
    from surefoot.lockstep.launch import main

    PhysicsWorld._run_to = timed  # pyright: ignore[reportPrivateUsage]
    main(TimedSimulator)
