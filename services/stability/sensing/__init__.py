"""Measurements of the robot: posture, forces under its feet, their calibration, its CoM, its state while it walks."""
