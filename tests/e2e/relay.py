"""A bad link between two TAP devices: frames are delayed, lost, doubled and overtake each other, by a seed.

`python -m tests.e2e.relay A B --delay 0.002 --loss 0.01`, as root, until SIGTERM; then it prints what became of the
frames, as JSON. It needs no module of the kernel.
"""

import argparse
import fcntl
import heapq
import json
import os
import select
import signal
import struct
import time
from collections import Counter
from collections.abc import Sequence
from random import Random
from typing import Any

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
FRAME = 65_536  # bytes, more than any frame
MOST = 20_000  # frames that wait, as a queue of a real link


def open_tap(name: str) -> int:
    """Return a descriptor that reads and writes the frames of a TAP device."""
    tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TAP | IFF_NO_PI))
    return tap


def relay(taps: Sequence[int], options: argparse.Namespace, counts: Counter[str]) -> None:
    """Pass frames from each device to the other, for ever."""
    random = Random(options.seed)
    waiting: list[tuple[float, int, int, bytes]] = []
    number = 0
    poll = select.poll()
    for tap in taps:
        poll.register(tap, select.POLLIN)
    while True:
        left = waiting[0][0] - time.monotonic() if waiting else 1.0
        for tap, _ in poll.poll(max(0.0, 1e3 * left)):
            frame, other = os.read(tap, FRAME), taps[tap == taps[0]]
            if random.random() < options.loss or len(waiting) >= MOST:
                counts["lost"] += 1
                continue
            doubled = random.random() < options.double
            counts["doubled"] += doubled
            for _ in range(1 + doubled):
                number += 1
                due = time.monotonic() + options.delay + options.jitter * random.random()
                heapq.heappush(waiting, (due, number, other, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            _, _, tap, frame = heapq.heappop(waiting)
            os.write(tap, frame)
            counts["passed"] += 1


def main() -> None:
    """Read the options, pass frames, print counts at the end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("taps", nargs=2)
    parser.add_argument("--delay", type=float, default=0.0, help="of each frame, s")
    parser.add_argument("--jitter", type=float, default=0.0, help="most that is added to the delay, uniform, s")
    parser.add_argument("--loss", type=float, default=0.0, help="share of frames that are lost")
    parser.add_argument("--double", type=float, default=0.0, help="share of frames that arrive twice")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts = Counter[str]()

    def end(*_: Any) -> None:
        os.write(1, json.dumps(counts).encode())
        os._exit(0)

    signal.signal(signal.SIGTERM, end)
    relay([open_tap(name) for name in options.taps], options, counts)


if __name__ == "__main__":
    main()
