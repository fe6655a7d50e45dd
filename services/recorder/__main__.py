"""``python -m surefoot.services.recorder``."""

from surefoot.lockstep.launch import main
from surefoot.services.recorder.service import SERVICE

main(SERVICE)
