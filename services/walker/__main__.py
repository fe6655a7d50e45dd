"""``python -m surefoot.services.walker``."""

from surefoot.lockstep.launch import main
from surefoot.services.walker.service import SERVICE

main(SERVICE)
