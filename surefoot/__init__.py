"""surefoot: bus, lockstep, robots, geometry, recording and the public client; the services and the lab above them."""
