"""``python -m surefoot.services.vision``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
