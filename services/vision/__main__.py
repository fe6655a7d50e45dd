"""Entry point of the vision service as a process: ``python -m surefoot.services.vision``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
