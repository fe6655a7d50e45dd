"""``python -m surefoot.services.estimator``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
