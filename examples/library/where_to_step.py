"""Where should this foot be put? Heights in, the best place and the free rectangle around it out."""

import surefoot

ground = surefoot.terrain.generate("rough", seed=3)
patch = ground.patch(0.3, 0.1, 41)
found = surefoot.terrain.foothold(patch, ground.cell, stroke=(-0.05, 0.0, 0.0), nominal=(0.01, 0.0))
print(f"step to {found.foothold}, {1e3 * found.slip * 0.05:.1f} mm of slip expected")
print(f"free: {found.rectangle}; cells by reason: {found.counts}")
