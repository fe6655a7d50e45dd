"""Index of the command line: where each command is defined and what `surefoot --help` shows of it.

With it a command imports its own module only, and the help of the program none. The words are those of the functions
and groups themselves, which a test compares.
"""

from typing import NamedTuple


class Entry(NamedTuple):
    """One command, or group of commands, of the program."""

    module: str
    """Module below `surefoot.lab`; one that ends in `.commands` brings an app of its own."""
    function: str
    """Name of the function of a command in that module; empty: the module has a typer `app`."""
    help: str
    """First paragraph of its help text."""


INDEX: dict[str, Entry] = {
    "run": Entry(
        "cli.run",
        "run",
        "Run a scenario with every service live, check its limits, write a report. Exit code 1: a limit was not met.",
    ),
    "list": Entry("cli.run", "list_all", "List scenarios, systems, robots and services."),
    "up": Entry("cli.system", "up", "Start the services of a compose file and keep them running."),
    "down": Entry("cli.system", "down", "Stop a running system, or the remaining processes of one that crashed."),
    "stop": Entry(
        "cli.stop",
        "stop",
        "Emergency stop of every system that runs, or of one: the robot holds its joints until the next "
        "reset. Exit code 1: a driver did not confirm.",
    ),
    "status": Entry(
        "cli.system",
        "status",
        "Show the running systems and their health. Exit code 1: nothing runs, or a service is not healthy.",
    ),
    "logs": Entry("cli.system", "logs", "Show the logs of the services in the order of time."),
    "health": Entry(
        "cli.system",
        "health",
        "Request the health of a service, as the probe in compose files. Exit code 1: it is not healthy.",
    ),
    "supervise": Entry(
        "cli.system",
        "supervise",
        "Run the router, and supervise a system whose services are started by a container engine.",
    ),
    "report": Entry(
        "cli.report",
        "report",
        "Write the report of a recording, by the limits it carries. Exit code 1: a limit was not met.",
    ),
    "render": Entry(
        "cli.render",
        "render",
        "Paint a recording as a moving picture: robot, ground, support region, centre of mass, forces.",
    ),
    "view": Entry(
        "cli.view",
        "view",
        "Show a running system, or a recording, in a browser on this machine; over SSH by a tunnel. Ends with Ctrl-C.",
    ),
    "warm": Entry(
        "cli.warm",
        "warm",
        "Compile the numeric kernels that the services of systems use, so that every later start is quick.",
    ),
    "call": Entry(
        "cli.service",
        "call",
        "Call a query and print its reply as JSON. Exit code 1: it was not accepted, or no service answered.",
    ),
    "doctor": Entry(
        "cli.doctor",
        "doctor",
        "Check this machine: versions, kernels, port, Zenoh, timer, simulator, leftovers. Exit code 1: "
        "something fails.",
    ),
    "graph": Entry(
        "cli.graph",
        "graph",
        "Print the topics and queries that connect the services, from the declarations of the services.",
    ),
    "topic": Entry("cli.topic", "", "Topics: list, show, echo, publish, measure."),
    "service": Entry("cli.service", "", "Queries the services answer: list, show, call."),
    "node": Entry("cli.node", "", "Services of a running system: list, show."),
    "param": Entry("cli.param", "", "Parameters of running services: list, get, set."),
    "schema": Entry("cli.schema", "", "JSON Schemas of everything on the wire, and of hand-written files."),
    "bag": Entry("bags.commands", "", "Recordings (MCAP): record, play, show."),
    "robot": Entry("cli.robot", "", "Robot descriptions."),
    "goal": Entry("cli.goal", "", "The goal of the navigator: pause, resume, cancel."),
    "sim": Entry("cli.sim", "", "Simulated time: pause, step, disturb, begin anew."),
    "bridge": Entry("cli.bridge", "", "Live bridges to the programs of others."),
    "why": Entry(
        "again.commands",
        "",
        "Walk back from a fall, stop, halt, missed goal or slip to its first cause. Exit code 1: something "
        "went wrong, a part of the recording cannot be read, or its clock jumps.",
    ),
    "verify": Entry(
        "again.commands",
        "",
        "Repeat a run from its recording alone and compare every deterministic message. Exit code 1: it differs.",
    ),
    "bisect": Entry(
        "again.commands",
        "",
        "Name the first message and field in which two recordings differ. Exit code 1: there is one, or a "
        "recording cannot be read to its end.",
    ),
    "whatif": Entry(
        "again.commands",
        "",
        "Go on from a moment of a recorded run with something changed, in the same world, and compare both.",
    ),
    "audit": Entry(
        "audit.commands",
        "",
        "Check every stability margin in a recording, by proofs that need no solver. Exit code 1: one is contradicted.",
    ),
    "chaos": Entry(
        "chaos.commands",
        "",
        "Run a scenario with random faults drawn from a seed. Exit code 1: it was unsafe, or a service did "
        "not recover.",
    ),
    "estimate": Entry(
        "estimation.commands",
        "",
        "Estimate velocity, tilt and path from a log, with covariance and flags; errors where the log has truth.",
    ),
    "compare": Entry(
        "estimation.commands",
        "",
        "Compare two estimates of one log: differences in velocity, tilt, position and heading, and both scores.",
    ),
    "fit": Entry("fit.commands", "", "Numbers of a robot from recordings of it."),
    "footholds": Entry(
        "footholds.commands",
        "",
        "Slip models: collect stances, learn from them, look at what was learned.",
    ),
    "map": Entry("maps.commands", "", "Maps: landmarks from a recording, occupancy of map_server."),
    "security": Entry("security.commands", "", "Certificates of a system's processes and people."),
    "train": Entry("train.commands", "", "Make policies."),
    "evaluate": Entry("train.commands", "", "Measure how good something is that was trained or fitted."),
}
"""Entry of each command in the order of the help; those of `papers`, which may be absent, come after them."""
