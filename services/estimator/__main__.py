"""``python -m surefoot.services.estimator``."""

from surefoot.lockstep.launch import main
from surefoot.services.estimator.service import SERVICE

main(SERVICE)
