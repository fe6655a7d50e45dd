"""``python -m surefoot.services.unitree``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
