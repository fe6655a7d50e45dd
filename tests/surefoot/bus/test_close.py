"""End of a session: nothing of it works on."""

import threading

from surefoot.bus.interface import Delivery
from surefoot.schemas.hw import Imu
from surefoot.schemas.topics import HW_IMU
from tests.surefoot.net import WAIT_S, Net, matched, wait_until


def test_the_end_waits_for_readers_that_have_ended(net: Net) -> None:
    """One that is in the network library still when the interpreter ends aborts the process."""
    owner, reader = net.open(), net.open("client")
    publisher, held, go_on = owner.publisher(HW_IMU), threading.Event(), threading.Event()
    seen: list[threading.Thread] = []

    def sink(delivery: Delivery) -> None:
        seen.append(threading.current_thread())
        held.set()
        go_on.wait(WAIT_S)

    end = reader.listen(HW_IMU, sink)

    def heard() -> bool:
        publisher.put(Imu(acc=(0.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)))
        return held.is_set()

    wait_until(heard)
    end()
    later = threading.Timer(0.1, go_on.set)  # the reader works while the session is closed
    later.start()
    reader.close()
    later.join()
    assert not seen[0].is_alive()


def test_a_reader_that_looks_now_and_then_ends_its_subscription_with_its_function(net: Net) -> None:
    look = net.open("client").newest(HW_IMU)
    publisher = matched(net.open(), HW_IMU)
    assert look() is None
    del look
    wait_until(lambda: not publisher._publisher.matching_status.matching)
