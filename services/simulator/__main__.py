"""Entry point of the simulator service as a process: ``python -m surefoot.services.simulator``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
