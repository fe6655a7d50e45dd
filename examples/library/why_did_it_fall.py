"""Why did it fall? A walk onto ice is recorded, and explained from the recording alone."""

import tempfile
from pathlib import Path

import surefoot

ICE = """
description = "the ground turns to ice"
compose = "ragno"
max_duration_s = 7.0
[[step]]
when = "ready"
do = "walk"
[[step]]
at_tick = 450
do = "set"
quantity = "friction"
value = 0.02
"""
with tempfile.TemporaryDirectory() as folder:
    scenario, bag = Path(folder) / "ice.toml", Path(folder) / "run.mcap"
    scenario.write_text(ICE)
    surefoot.simulation.run(scenario, seed=1, recording=bag)
    found = surefoot.bags.why(bag)
print(found.sentence)
