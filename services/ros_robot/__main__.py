"""``python -m surefoot.services.ros_robot``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
