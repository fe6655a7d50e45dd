"""Entry point of the driver of a robot that publishes on ROS 2: ``python -m surefoot.services.ros_robot``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
