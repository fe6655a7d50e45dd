"""Will it fall? Distance of the centre of mass from the edge of the support region."""

import surefoot

feet = surefoot.stability.contacts([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.05]], friction=0.5)
for x in (0.0, 0.05, 0.15):
    margin = surefoot.stability.margin(feet, com=[x, 0.0])
    print(f"centre of mass at {x:.2f} m: margin {1e3 * margin:+.0f} mm, {'stands' if margin > 0 else 'falls'}")
