"""Entry point of the bridge to ROS 2 as a process: ``python -m surefoot.services.ros2``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
