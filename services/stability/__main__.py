"""Entry point of the stability service as a process: ``python -m surefoot.services.stability``."""

import gc

gc.disable()  # nothing that is imported becomes garbage: a tenth of the start; `main` enables it again

from surefoot.lockstep.launch import main  # noqa: E402

from .service import SERVICE  # noqa: E402

main(SERVICE)
