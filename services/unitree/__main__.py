"""Entry point of the driver of Unitree's quadrupeds as a process: ``python -m surefoot.services.unitree``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
