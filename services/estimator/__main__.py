"""Entry point of the estimator service as a process: ``python -m surefoot.services.estimator``."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
