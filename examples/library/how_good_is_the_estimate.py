"""How good is an estimate over a log? A recording is made, estimated again and compared with the truth."""

import tempfile
from pathlib import Path

import surefoot

with tempfile.TemporaryDirectory() as folder:
    bag = Path(folder) / "run.mcap"
    surefoot.simulation.run("stand", seed=3, recording=bag)
    result = surefoot.estimation.run(bag)
    print(f"{len(result.track.v)} rows, velocity error {1e3 * result.score.rmse:.1f} mm/s")
    samples = surefoot.bags.arrays(bag)
    print({name: samples[name].shape for name in ("gyro", "acc", "joints", "base_position")})
    print(surefoot.bags.info(bag)["metadata"]["run"]["scenario"])
    last = list(surefoot.bags.messages(bag, "state/stability"))[-1]
    print(f"margin at the end {last.margin_planned:.3f} m")
