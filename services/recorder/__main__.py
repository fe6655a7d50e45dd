"""Entry point of the recorder service as a process: ``python -m surefoot.services.recorder``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
