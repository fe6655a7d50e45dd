"""``python -m services.estimator``."""

from services.estimator.service import SERVICE
from surefoot.launch import main

main(SERVICE)
