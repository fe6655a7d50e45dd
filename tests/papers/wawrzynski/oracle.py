"""The filter of Wawrzynski et al. straight from its equations, corrected, in plain NumPy; shares no code with ours.

Equation numbers are the paper's. Settled where it is silent: the earlier foot counts until it lifts, a foot counts if
it touches at both samples, the gyro is the latest one, the correction follows the first inertial sample at or after the
kinematic stamp, the ankle is the fixed point, velocities of the joints are backward differences.
"""

import numpy as np


def cross_matrix(x):
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def f(b, x):
    """Rotation of x about the vector b (less than 0.1 rad), by the exponential series of its matrix."""
    matrix, out = cross_matrix(b), x
    for k in range(1, 10):
        x = matrix @ x / k
        out = out + x
    return out


def jacobian(x):
    """(26) with its sign corrected: df(b, x)/db at b = 0."""
    return -cross_matrix(x)


def one_foot(before, now, standing):
    """The foot that counts: the one of before while it stands, else the first that does; -1 = none."""
    both = [bool(a and b) for a, b in zip(before, now, strict=True)]
    if standing >= 0 and both[standing]:
        return standing
    return both.index(True) if True in both else -1


class Oracle:
    """State (g, v), (15)."""

    def __init__(self, g, n, sigma_w, sigma_q, sigma_v, prior_g, prior_v):
        self.g, self.v = np.array(g), np.zeros(3)  # (1)
        self.P = np.diag([sigma_q**2 / n + prior_g**2] * 3 + [prior_v**2] * 3)
        self.sigma_w, self.sigma_q, self.sigma_v = sigma_w, sigma_q, sigma_v

    def predict(self, w, q, d):
        zero, one = np.zeros((3, 3)), np.eye(3)
        F = np.block([[one, zero], [-one * d, one]])  # (24)
        Jg, Jv = jacobian(self.g), jacobian(self.v)
        C = np.block(
            [
                [Jg * d * self.sigma_w, zero],
                [Jv * d * self.sigma_w - Jg * d**2 * self.sigma_w / 2, -one * d * self.sigma_q],
            ]
        )  # (25)
        self.P = F @ self.P @ F.T + C @ C.T  # (31)
        self.g = f(-w * d / 2, self.g)  # (28)
        self.v = f(-w * d, self.v) + (q - self.g) * d  # (29)
        self.g = f(-w * d / 2, self.g)  # (30)

    def correct(self, v_kg):
        H = np.hstack([np.zeros((3, 3)), np.eye(3)])  # (33)
        S = H @ self.P @ H.T + np.eye(3) * self.sigma_v**2  # (34)
        K = self.P @ H.T @ np.linalg.inv(S)  # (35)
        step = K @ (v_kg - self.v)  # (32)
        self.g, self.v = self.g + step[:3], self.v + step[3:]  # (36)
        self.P = (np.eye(6) - K @ H) @ self.P  # (37)
        self.P = (self.P + self.P.T) / 2


def run(log, start, samples, sigma_w, sigma_q, sigma_v, prior_g, prior_v):
    """Walk along a log; the filter begins with row `start`, from the mean of the `samples` rows up to it.

    Returns:
        v, g and P at every row from `start` on.
    """
    rest = log.q[start - samples + 1 : start + 1].mean(axis=0)
    it = Oracle(rest, samples, sigma_w, sigma_q, sigma_v, prior_g, prior_v)
    out, foot, k, last = [], -1, 0, None
    stamps, feet_ns = log.stamp_ns, log.foot_ns
    for row, stamp in enumerate(stamps):
        if row >= start:
            it.predict(log.w[row], log.q[row], 1e-9 * float(stamp - stamps[row - 1]))
        while k < len(feet_ns) and feet_ns[k] <= stamp:
            if last is not None:
                foot = one_foot(log.contact[last], log.contact[k], foot)
                if foot >= 0 and row >= start:
                    a, b = log.foot_position[last, foot], log.foot_position[k, foot]
                    d = 1e-9 * float(feet_ns[k] - feet_ns[last])
                    it.correct(-(b - a) / d - np.cross(log.w[row], (a + b) / 2))  # (5)-(14) as differences
            last, k = k, k + 1
        if row >= start:
            out.append((it.v.copy(), it.g.copy(), it.P.copy()))
    return tuple(np.array(part) for part in zip(*out, strict=True))
