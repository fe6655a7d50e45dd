"""A robot of toys in a process of its own, a thread and a session for each node: `python -m ... ADDRESS NAMESPACE`.

Prints as JSON the history of its driver and the ticks that its observer received.
"""

import json
import sys

from tests.surefoot.lockstep.test_zenoh_run import Threads
from tests.surefoot.net import Net


def main(address: str, namespace: str) -> None:
    """Walk for 40 ticks on the network of a router that others run."""
    net = Net(namespace, address, router=False)
    try:
        with Threads(net, (0, 1, 2, 3), ticks=40) as robot:
            sys.stdout.write(json.dumps([robot.wait(), [tick for tick, _ in robot.observer.seen]]))
    finally:
        net.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
