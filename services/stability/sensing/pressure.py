"""Force-sensing resistors under the feet, which measure stance forces directly (Walas & Belter 4.5, Fig. 18).

The resistance falls with the force as a power law; with a fixed resistor it divides the supply voltage:

    R(F) = R_1 F^-p,   V = V_s R_f / (R_f + R(F))

Walas & Belter print the curve without numbers: those here are typical of such sensors, in a circuit that is fairly
linear in the range they name, 0.5 to 2 kg. Outside of the range a reading means only that the force is less, or more.
"""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array

KILOGRAM = 9.81  # N, weight of one


@dataclass(frozen=True, slots=True)
class PressureSensor:
    """Characteristic of one force-sensing resistor with its fixed resistor and its converter."""

    resistance_1n: float = 60e3
    """Resistance R_1 of the sensor at 1 N, Ohm: typical of a sensing area of 1 cm^2."""
    exponent: float = 0.9
    """Exponent p of the sensor's resistance R_1 F^-p over the force F, no unit."""
    fixed: float = 1e3
    """Fixed resistor R_f in series with the sensor, Ohm."""
    supply: float = 5.0
    """Supply voltage V_s of the divider, V."""
    least: float = 0.5 * KILOGRAM
    """Least force of the sensor's range, N (0.5 kg by Walas & Belter); below, a reading only shows that it is less."""
    most: float = 2.0 * KILOGRAM
    """Largest force of the sensor's range, N (2 kg by Walas & Belter); above, a reading only shows that it is more."""
    step: float = 5.0 / 1024.0
    """Resolution of the converter, V (10 bits)."""
    repeatability: float = 0.02
    """Standard deviation of a reading as a fraction of the force: place and shape of the contact vary."""

    def voltage(self, force: Array) -> Array:
        """Return the output of the divider, V, under forces F >= 0 in N, of any shape."""
        with np.errstate(divide="ignore"):
            return self.supply * self.fixed / (self.fixed + self.resistance_1n * force**-self.exponent)

    def force(self, voltage: Array) -> Array:
        """Return the forces in N for voltages 0 <= V < V_s, V, of any shape: the inverse of the characteristic."""
        return (self.resistance_1n * voltage / (self.fixed * (self.supply - voltage))) ** (1.0 / self.exponent)

    def line(self) -> tuple[float, float]:
        """Return offset, N, and slope, N/V, of force over voltage: the best line (least squares) in the range."""
        force = np.linspace(self.least, self.most, 101)
        slope, offset = np.polyfit(self.voltage(force), force, 1)
        return float(offset), float(slope)

    def linearised(self, voltage: Array) -> Array:
        """Return the forces, N, of the best straight line for voltages, V, of any shape, as a small controller does."""
        offset, slope = self.line()
        return offset + slope * voltage

    def linearity_error(self) -> float:
        """Return the largest error of the straight line inside the range, N."""
        force = np.linspace(self.least, self.most, 401)
        return float(np.abs(self.linearised(self.voltage(force)) - force).max())

    def variance(self, force: Array) -> Array:
        """Return the variance of forces, N, of any shape, read by the characteristic, N^2.

        It holds the repeatability of the sensor and one step of the converter.
        """
        slope = (self.voltage(force * 1.001) - self.voltage(force * 0.999)) / (0.002 * force)
        return (self.repeatability * force) ** 2 + (self.step / slope) ** 2 / 12.0


def read_loads(load: Array, sensor: PressureSensor) -> tuple[Array, Array]:
    """Return usable loads under L feet, (L,) N, and their variances, (L,) N^2, from reported loads, (L,) N.

    A load below the range of the sensor becomes half of the range's least load, a load above it, or NaN, becomes NaN.
    """
    below, inside = load < sensor.least, (load >= sensor.least) & (load < sensor.most)
    value = np.where(inside, load, np.where(below, 0.5 * sensor.least, np.nan))
    variance = np.where(below, sensor.least**2 / 12.0, sensor.variance(np.where(inside, load, sensor.least)))
    return value, variance
