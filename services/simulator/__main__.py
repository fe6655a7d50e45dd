"""``python -m surefoot.services.simulator``."""

from surefoot.lockstep.launch import main
from surefoot.services.simulator.service import SERVICE

main(SERVICE)
