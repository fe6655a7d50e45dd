"""``python -m surefoot.services.ros2``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
