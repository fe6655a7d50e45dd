"""``python -m surefoot.services.footholds``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
