"""The runtime of surefoot: bus, lockstep, robots, kinematics, recording and the public client."""
