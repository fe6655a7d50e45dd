"""Physical constants, each defined here only."""

GRAVITY = 9.81
"""Standard acceleration of free fall as every robot, filter and simulator of this project takes it, m/s^2."""
