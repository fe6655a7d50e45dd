"""Base class of services. The runtime around it is ``surefoot.lockstep.node``."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import Input, TickInputs
from surefoot.schemas.base import Message, Wire
from surefoot.schemas.rows import M, Rep, Req
from surefoot.schemas.topics import Query, Topic

C = TypeVar("C", bound=ServiceConfig)


class Runtime(Protocol):
    """Functions that the runtime (``surefoot.lockstep.node``) offers to a service."""

    def publish(self, topic: Topic[Any], message: Message, stamp_ns: int | None) -> None:
        """Publish a message with the header of the present tick; ``stamp_ns``: of the sample, None = the tick's."""
        ...

    def call(self, query: Query[Req, Rep], request: Req, timeout_s: float | None) -> Rep:
        """Send a request to another service and return its reply (raises CallError)."""
        ...

    def log(self, level: str, text: str) -> None:
        """Write a line to the log and to ``log/<service>``."""
        ...


class Service(Generic[C]):
    """Base of all services: a process that computes outputs from its declared inputs in each control tick.

    Subclasses declare the topics they read and publish and the queries they serve and call; the runtime checks every
    use against the declaration, and the graph, the start order and the documentation are derived from it.
    """

    name: ClassVar[str]
    Config: ClassVar[type[ServiceConfig]] = ServiceConfig
    inputs: tuple[Input, ...] = ()
    """Topics that a tick reads; an instance may read fewer than its class declares, depending on its configuration."""
    outputs: ClassVar[tuple[Topic[Any], ...]] = ()
    serves: ClassVar[tuple[Query[Any, Any], ...]] = ()
    calls: ClassVar[tuple[Query[Any, Any], ...]] = ()
    observes: ClassVar[tuple[Topic[Any], ...]] = ()
    """Topics outside lockstep (health, logs): delivered to ``on_message`` as they come."""
    batched: bool = False
    """True if the service may receive several ticks at a time, as no participant awaits its output; False: one by
    one."""
    limits: Mapping[str, int] = {}
    """Age of an input, ns of simulated time, above which it counts as late, by key; 0 = never. Default: three periods
    of the input, at least 100 ms (``surefoot.lockstep.ages``). Read when an epoch begins; late inputs are named in
    ``TickInputs.late``, the log, health and the report."""
    raw: ClassVar[bool] = False
    """True if inputs are passed on undecoded, as ``Delivery``; False: as decoded messages."""

    def __init__(self, config: C) -> None:
        self.config = config
        self.handlers: dict[str, Callable[[Any], Wire | Future[Any]]] = {}
        self._runtime: Runtime | None = None
        self.trouble = ""
        """Reason why a service that runs cannot do all of its work, in words, for its health; empty = it can."""

    # -- overridden --------------------------------------------------------------------------------------------

    def on_start(self) -> None:
        """Prepare the service once, before any message arrives: register handlers, load the robot."""

    def rehearse(self) -> None:
        """Load or compile all kernels by example computations, so that no tick has to; called once, after ``on_start``.

        An override publishes nothing and does not change later results. It takes less than 0.1 s once the kernels are
        compiled.
        """

    def rehearse_rare(self) -> None:
        """Compile the kernels of rare queries; called by `surefoot warm --all`, not at the start of the service."""

    def on_reset(self) -> None:
        """Drop all state of the last run at the beginning of a new one (epoch)."""

    def on_config(self) -> None:
        """Apply changed live parameters; called between two ticks after ``config`` was replaced."""

    def on_tick(self, inputs: TickInputs) -> None:
        """Compute one tick from its inputs, and publish the outputs."""

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Handle a message of a topic in ``observes``."""

    def on_stop(self) -> None:
        """Release resources such as files; called once, when the service ends."""

    # -- used --------------------------------------------------------------------------------------------------

    def attach(self, runtime: Runtime) -> None:
        """Set the runtime of the service, before ``on_start``."""
        self._runtime = runtime

    @property
    def runtime(self) -> Runtime:
        """Runtime of the service, available from ``on_start`` on."""
        assert self._runtime is not None
        return self._runtime

    def handle(self, query: Query[Req, Rep], handler: Callable[[Req], Rep | Future[Rep]]) -> None:
        """Register the handler of a declared query; it must not call other services.

        A handler whose work would delay ticks returns a future of the reply; that work runs on another thread of the
        service and must use only the request.
        """
        if query.key not in {served.key for served in self.serves}:
            raise ValueError(f"{self.name} handles {query.key!r} but does not declare it in serves")
        self.handlers[query.key] = handler

    def publish(self, topic: Topic[M], message: M, stamp_ns: int | None = None) -> None:
        """Publish a declared output; a message in a tick that the rate of its topic leaves out is dropped.

        Args:
            topic: one of the topics in `outputs`.
            message: its header is filled in.
            stamp_ns: time of the sample, ns; default: that of the tick.

        Raises:
            ValueError: the service does not declare the topic.
        """
        self.runtime.publish(topic, message, stamp_ns)

    def call(self, query: Query[Req, Rep], request: Req, timeout_s: float | None = None) -> Rep:
        """Send a request to another service; return its reply (raises CallError). `timeout_s`: None = the query's."""
        return self.runtime.call(query, request, timeout_s)

    def log(self, level: str, text: str) -> None:
        """Write a line to the log; level is debug, info, warning or error."""
        self.runtime.log(level, text)
