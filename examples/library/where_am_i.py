"""Where am I on the map? Motions predict, a landmark corrects, the covariance knows how sure it is."""

import numpy as np

import surefoot

belief = surefoot.navigation.PoseFilter(pose=(0.0, 0.0, 0.0))
for _ in range(10):
    belief.predict(forward=0.1, turn=0.02, sd=(0.01, 0.01, 0.02))
print("before", np.round(belief.pose, 3), f"{belief.entropy:.2f} nats")
nis = belief.landmark(place=(2.0, 0.5), distance=1.08, bearing=0.22, sd=(0.05, 0.03))
print("after ", np.round(belief.pose, 3), f"{belief.entropy:.2f} nats, NIS {nis:.1f}")
