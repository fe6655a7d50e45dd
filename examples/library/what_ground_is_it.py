"""What ground is it? Heights along a line, from a map that was saved and read again."""

import tempfile
from pathlib import Path

import numpy as np

import surefoot

with tempfile.TemporaryDirectory() as folder:
    path = surefoot.terrain.save(surefoot.terrain.generate("steps", seed=1), Path(folder) / "steps.npz")
    ground = surefoot.terrain.load(path)
print(f"{ground.shape} cells of {ground.cell} m, x and y in {ground.bounds} m")
print(np.round(ground.height(np.arange(0.0, 1.0, 0.1), 0.0), 3))
