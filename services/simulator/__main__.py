"""``python -m surefoot.services.simulator``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
