"""How long does a region take? A thousand random sets of six contacts."""

import time

import numpy as np

import surefoot

rng = np.random.default_rng(0)
sets = [surefoot.stability.contacts(rng.normal(0.0, 0.1, (6, 3)), friction=0.5) for _ in range(1000)]
surefoot.stability.region(sets[0])  # the first call loads the compiled code
began = time.perf_counter()
areas = [surefoot.stability.region(feet).area for feet in sets]
print(f"{1e3 * (time.perf_counter() - began):.0f} us each, mean area {1e4 * np.mean(areas):.0f} cm2")
