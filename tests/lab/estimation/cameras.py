"""A simulated camera that sees the pose of the IMU in a frame of its own: 10 Hz, 80 ms late, with noise and jumps."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.external import Externals
from surefoot.lab.estimation.log import Log
from surefoot.services.estimator.inputs.external import ExternalSample


@dataclass(frozen=True)
class Camera:
    """Frame, noise and faults of a camera."""

    turn: float = 2.0  # rad, of its frame
    shift: tuple[float, float, float] = (3.0, -2.0, 0.5)  # m
    sd: float = 0.005  # m
    yaw_sd: float = 0.01  # rad
    late_ns: int = 80_000_000
    every: int = 10  # inertial rows
    wrong: float = 0.0  # share of the samples that are 0.5 m off
    jump_s: float = np.inf  # from then on the frame is shifted by 1 m and turned by 0.5 rad
    parts: tuple[str, ...] = ("position", "yaw")

    def samples(self, log: Log, seed: int = 0) -> list[tuple[int, ExternalSample]]:
        """Return time, ns, and sample of each image."""
        rng, out = np.random.default_rng(seed), []
        heading = np.unwrap(np.arctan2(log.rot[:, 1, 0], log.rot[:, 0, 0]))
        for i in range(3, len(log.stamp_ns), self.every):
            late = log.seconds[i] >= self.jump_s
            turn = self.turn + 0.5 * late
            frame = Rotation.from_euler("z", turn).as_matrix()
            p = frame @ log.position[i] + self.shift + late + rng.normal(size=3) * self.sd
            p += 0.5 * (rng.random() < self.wrong)
            v = log.v[i] + rng.normal(size=3) * self.sd
            values = {
                "position": p, "position_covariance": np.eye(3) * self.sd**2, "velocity": v,
                "velocity_covariance": np.eye(3) * self.sd**2, "yaw_variance": self.yaw_sd**2,
                "yaw": float(heading[i] + turn + rng.normal() * self.yaw_sd),
            }  # fmt: skip
            chosen = {key: value for key, value in values.items() if key.split("_")[0] in self.parts}
            out.append((int(log.stamp_ns[i]), ExternalSample(**chosen)))
        return out

    def seen(self, log: Log, seed: int = 0) -> Externals:
        """Return the samples of a log."""
        found = self.samples(log, seed)
        stamps = np.array([stamp for stamp, _ in found])
        return Externals(stamps, stamps + self.late_ns, np.array([one.row()[0] for _, one in found]))
