"""Data of the figures and findings of Walas & Belter (2011), section 4."""

from dataclasses import dataclass

from surefoot.robot.description import Robot
from surefoot.services.stability.sensing.pressure import PressureSensor

from . import messor as walas_messor
from . import ragno as walas_ragno


@dataclass(frozen=True)
class StabilityStudy:
    """Results of the study of Walas & Belter, section 4: robots, sensor, and all experiments on stability."""

    ragno: Robot
    messor: Robot
    postures: tuple[walas_ragno.Posture, ...]
    slopes: tuple[walas_ragno.Slope, ...]
    sensor: PressureSensor
    sweep: walas_messor.Sweep
    standing: walas_messor.StandingStudy
    gait: walas_messor.GaitStudy
    errors: tuple[walas_messor.ComErrors, ...]
    small_errors: tuple[walas_messor.ComErrors, ...]

    @property
    def demo(self) -> walas_ragno.Slope:
        """Result on the slope with the friction coefficient that Fig. 17 of Walas & Belter is drawn with."""
        return next(s for s in self.slopes if s.mu == walas_ragno.DEMO_MU)
