"""``python -m surefoot.services.footholds``."""

from surefoot.lockstep.launch import main
from surefoot.services.footholds.service import SERVICE

main(SERVICE)
