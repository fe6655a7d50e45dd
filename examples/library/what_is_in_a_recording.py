"""What is in a recording? Samples as arrays, messages one by one, and what was run; here of a robot that stands."""

import tempfile
from pathlib import Path

import surefoot

with tempfile.TemporaryDirectory() as folder:
    bag = Path(folder) / "run.mcap"
    surefoot.simulation.run("stand", seed=3, recording=bag)
    info, samples = surefoot.bags.info(bag), surefoot.bags.arrays(bag)
    last = list(surefoot.bags.messages(bag, "state/stability"))[-1]
print(f"{info['messages']} messages of {len(info['topics'])} topics, of {info['metadata']['run']['scenario']}")
print({name: samples[name].shape for name in ("gyro", "acc", "joints", "base_position")})
print(f"margin at the end {last.margin_planned:.3f} m")
