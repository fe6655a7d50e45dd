"""Entry point of the mapper service as a process: ``python -m surefoot.services.mapper``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
