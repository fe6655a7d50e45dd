"""``python -m surefoot.services.navigator``."""

from surefoot.lockstep.launch import main
from surefoot.services.navigator.service import SERVICE

main(SERVICE)
