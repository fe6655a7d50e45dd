"""Entry point of the walker service as a process: ``python -m surefoot.services.walker``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
