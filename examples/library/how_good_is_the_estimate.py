"""How good is an estimate over a log? A recording is made, estimated again and compared with the truth."""

import tempfile
from pathlib import Path

import surefoot

with tempfile.TemporaryDirectory() as folder:
    bag = Path(folder) / "run.mcap"
    surefoot.simulation.run("stand", seed=3, recording=bag)
    result = surefoot.estimation.run(bag)
print(f"{len(result.track.v)} rows, velocity error {1e3 * result.score.rmse:.1f} mm/s")
