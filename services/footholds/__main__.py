"""Entry point of the foothold service as a process: ``python -m surefoot.services.footholds``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
