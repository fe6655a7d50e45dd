"""Entry point of the navigator service as a process: ``python -m surefoot.services.navigator``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
