"""Simulators on the network as workers of a campaign of ground primitives."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from surefoot.bus.zenoh import ZenohBus, client_options
from surefoot.client import Client
from surefoot.errors import SurefootError
from surefoot.schemas.sim import ExperimentReply, ExperimentRequest
from surefoot.schemas.topics import SIM_EXPERIMENT

from .primitives import Worker

PATIENCE_S = 30.0
"""Longest wait for a worker's reply to a batch of trials, s; after it the worker counts as failed."""


def remote_worker(client: Client, patience_s: float = PATIENCE_S) -> Worker:
    """Return a worker that sends trials to the simulator of a client, even while it runs a scenario."""

    def answer(request: ExperimentRequest) -> ExperimentReply:
        return client.call(SIM_EXPERIMENT, patience_s, **dict(request))

    return answer


@contextmanager
def remote_workers(places: Sequence[str], patience_s: float = PATIENCE_S) -> Iterator[list[Worker]]:
    """Connect to simulators on the network, and yield a worker for each.

    Args:
        places: `namespace@endpoint` of each simulator, e.g. `surefoot/ragno@tcp/127.0.0.1:7447`.
        patience_s: longest wait for the reply to a batch, s.

    Raises:
        SurefootError: a place is not of the form `namespace@endpoint`.
        BusError: no router answers at an endpoint.
    """
    with ExitStack() as stack:
        workers: list[Worker] = []
        for place in places:
            namespace, at, endpoint = place.partition("@")
            if not (at and namespace and endpoint):
                raise SurefootError("invalid", f"must be namespace@endpoint, got {place!r}", "worker")
            workers.append(
                remote_worker(stack.enter_context(Client(ZenohBus(client_options(endpoint, namespace)))), patience_s)
            )
        yield workers
