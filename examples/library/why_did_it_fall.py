"""Why did it fall? A walk is recorded, in which the robot is pushed, and explained from the recording alone."""

import tempfile
from pathlib import Path

import surefoot

walk, push = {"when": "ready", "do": "walk"}, {"at_tick": 250, "do": "push", "force": [0, 120, 0], "duration": 0.3}
scenario = {"description": "a push from the side", "max_duration_s": 5.0, "step": [walk, push]}
with tempfile.TemporaryDirectory() as folder:
    bag = Path(folder) / "run.mcap"
    surefoot.simulation.run(scenario, seed=1, recording=bag)
    print(surefoot.bags.why(bag).sentence)
