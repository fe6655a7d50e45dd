"""What the robot itself tells: forces under its feet, their calibration, its CoM, its state while it walks."""
