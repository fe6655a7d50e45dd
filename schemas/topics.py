"""THE table of topics and queries: one row per key, typed by the model it carries.

Keys are relative to the session namespace ``<fleet>/<robot>``. A key that ends in ``/*`` is a family with one member
per service; ``of(service)`` names the member.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Generic, TypeVar, cast

from . import (
    base,
    calibration,
    cmd,
    footholds,
    hw,
    navigation,
    sim,
    stability,
    state,
    system,
    terrain,
    whatif,
)

M = TypeVar("M", bound=base.Message)
Req = TypeVar("Req", bound=base.Request)
Rep = TypeVar("Rep", bound=base.Wire)

TICK_NS = 10_000_000
"""Length of a control tick, ns (100 Hz)."""
TICK_S = TICK_NS / 1e9
"""Length of a control tick, s."""

KINEMATICS_NS = 33_000_000
"""Period of encoders and foot switches, ns (the Bioloid bus of Wawrzynski et al.: 33 ms)."""


VARIANT_TICKS = 5
"""The estimators run side by side at full rate; their variants are published in every fifth tick (20 Hz)."""


class Kind(Enum):
    """How a topic is delivered; the bus maps it to Zenoh's quality of service."""

    SAMPLE = "sample"  # hw/*: released by the driver, listed in the tick's manifest
    STATE = "state"  # periodic output of a function service
    COMMAND = "command"  # to the driver
    LATCHED = "latched"  # one value per epoch or version
    LOCKSTEP = "lockstep"  # the protocol's own
    STATUS = "status"  # wall-clock, for people
    ALARM = "alarm"  # must arrive, at once, from anybody


@dataclass(frozen=True)
class Topic(Generic[M]):
    """One row: key, model, kind, rate, owner."""

    key: str
    model: type[M]
    kind: Kind
    owner: str
    """Name of the publishing service; ``driver`` is the simulator or a hardware driver; ``*`` is every service."""
    period_ticks: int = 1
    """Published in every n-th tick; 0 = no fixed tick (samples, latched, status)."""
    period_ns: int = 0
    """Sampling period of a SAMPLE topic in simulated ns, 0 = none."""
    wall_period_s: float = 0.0
    """Period of a STATUS topic in wall time, 0 = event."""
    judging: bool = False
    """Told after the tick's frame and in batches only: for those who keep or judge a run, never for those who act."""
    deterministic: bool = True
    """Part of the run hash and recorded: same seed, same bytes."""

    def of(self, service: str) -> "Topic[M]":
        """The member of a ``/*`` family that belongs to ``service``."""
        if not self.key.endswith("/*"):
            raise ValueError(f"topic {self.key!r} is not a family; families end in '/*'")
        return replace(self, key=f"{self.key[:-1]}{service}", owner=service)

    @property
    def framed(self) -> bool:
        """True if participants get it inside the frame its owner publishes once a tick (``surefoot.bus.frame``)."""
        return self.kind in (Kind.SAMPLE, Kind.STATE, Kind.COMMAND) or self.key == HW_TICK.key

    def due(self, tick: int) -> bool:
        """Whether a periodic topic carries a message in ``tick``."""
        return self.period_ticks > 0 and tick % self.period_ticks == 0


@dataclass(frozen=True)
class Query(Generic[Req, Rep]):
    """One row: key, request and reply models, owner."""

    key: str
    request: type[Req]
    reply: type[Rep]
    owner: str
    timeout_s: float = 5.0
    acts: bool = False
    """Changes something. An empty request of any other query asks for its defaults; of these it is refused, for whoever
    gets all keys of a robot asks every query, with nothing."""

    def of(self, service: str) -> "Query[Req, Rep]":
        """The member of a ``/*`` family that belongs to ``service``."""
        if not self.key.endswith("/*"):
            raise ValueError(f"query {self.key!r} is not a family; families end in '/*'")
        return replace(self, key=f"{self.key[:-1]}{service}", owner=service)


# hardware contract: a driver provides hw/*, consumes cmd/*
HW_TICK = Topic("hw/tick", hw.Tick, Kind.LOCKSTEP, "driver", deterministic=False)
HW_IMU = Topic("hw/imu", hw.Imu, Kind.SAMPLE, "driver", period_ticks=0, period_ns=TICK_NS)
HW_JOINTS = Topic("hw/joints", hw.JointState, Kind.SAMPLE, "driver", period_ticks=0, period_ns=KINEMATICS_NS)
HW_CONTACTS = Topic("hw/contacts", hw.FootContacts, Kind.SAMPLE, "driver", period_ticks=0, period_ns=KINEMATICS_NS)
HW_LANDMARKS = Topic(
    "hw/landmarks", hw.LandmarkDetections, Kind.SAMPLE, "driver", period_ticks=0, period_ns=100_000_000
)
HW_RANGE = Topic("hw/range", hw.Range, Kind.SAMPLE, "driver", period_ticks=0, period_ns=100_000_000)
TERRAIN_MAP = Topic("terrain/map", terrain.HeightMapMessage, Kind.LATCHED, "driver", period_ticks=0)
TERRAIN_LANDMARKS = Topic("terrain/landmarks", terrain.LandmarkMap, Kind.LATCHED, "driver", period_ticks=0)
CMD_JOINTS = Topic("cmd/joints", hw.JointCommand, Kind.COMMAND, "walker")
CMD_ESTOP = Topic("cmd/estop", hw.EmergencyStop, Kind.ALARM, "*", period_ticks=0, deterministic=False)

# functions
STATE_VELOCITY = Topic("state/velocity", state.VelocityEstimate, Kind.STATE, "estimator")
STATE_VELOCITY_IMU = Topic(
    "state/velocity/imu", state.VelocityEstimate, Kind.STATE, "estimator", period_ticks=VARIANT_TICKS
)
STATE_VELOCITY_KINEMATICS = Topic(
    "state/velocity/kinematics", state.VelocityEstimate, Kind.STATE, "estimator", period_ticks=VARIANT_TICKS
)
STATE_VELOCITY_KINEMATICS_GYRO = Topic(
    "state/velocity/kinematics_gyro", state.VelocityEstimate, Kind.STATE, "estimator", period_ticks=VARIANT_TICKS
)
STATE_VELOCITY_EKF = Topic(
    "state/velocity/ekf", state.VelocityEstimate, Kind.STATE, "estimator", period_ticks=VARIANT_TICKS
)
STATE_ODOMETRY = Topic("state/odometry", state.Odometry, Kind.STATE, "estimator")
STATE_GAIT = Topic("state/gait", state.GaitState, Kind.STATE, "walker")
STATE_STABILITY = Topic("state/stability", stability.StabilityStatus, Kind.STATE, "stability", period_ticks=2)
STATE_POSE = Topic("state/pose", navigation.PoseBelief, Kind.STATE, "navigator", period_ticks=10)
NAVIGATOR_ORDER = Topic("navigator/order", navigation.MotionOrder, Kind.STATE, "navigator")
NAVIGATOR_FEEDBACK = Topic(
    "navigator/feedback", navigation.NavigationFeedback, Kind.STATE, "navigator", period_ticks=10
)

# simulation only
SIM_TRUTH = Topic("sim/truth", sim.Truth, Kind.SAMPLE, "driver", period_ticks=0, period_ns=TICK_NS, judging=True)
SIM_STATUS = Topic("sim/status", sim.SimStatus, Kind.STATUS, "driver", period_ticks=0, deterministic=False)

# runtime
TICK_DONE = Topic("tick/*", system.Done, Kind.LOCKSTEP, "*", deterministic=False)
HEALTH = Topic("health/*", system.Health, Kind.STATUS, "*", wall_period_s=1.0, deterministic=False, period_ticks=0)
LOG = Topic("log/*", system.LogRecord, Kind.STATUS, "*", deterministic=False, period_ticks=0)
SUPERVISOR_STATUS = Topic(
    "supervisor/status", system.SupervisorStatus, Kind.STATUS, "supervisor",
    wall_period_s=1.0, deterministic=False, period_ticks=0,
)  # fmt: skip

# queries
CMD_WALK = Query("cmd/walk", cmd.WalkCommand, cmd.WalkReply, "walker", acts=True)
HW_DESCRIPTION = Query("hw/description", hw.DescriptionRequest, hw.DescriptionReply, "driver")
TERRAIN_MAP_GET = Query("terrain/map", terrain.MapRequest, terrain.HeightMapMessage, "driver")
TERRAIN_LANDMARKS_GET = Query("terrain/landmarks", terrain.MapRequest, terrain.LandmarkMap, "driver")
FOOTHOLDS_SELECT = Query("footholds/select", footholds.SelectRequest, footholds.SelectReply, "footholds")
FOOTHOLDS_MODEL = Query("footholds/model", footholds.ModelRequest, footholds.ModelReply, "footholds", acts=True)
FOOTHOLDS_LEARN = Query("footholds/learn", footholds.LearnRequest, footholds.LearnReply, "footholds", acts=True)
FOOTHOLDS_ASSESS = Query("footholds/assess", footholds.AssessRequest, footholds.AssessReply, "footholds")
STABILITY_REGION = Query("stability/region", stability.RegionRequest, stability.RegionReply, "stability")
STABILITY_CHECK = Query("stability/check", stability.CheckRequest, stability.CheckReply, "stability")
STABILITY_COM = Query("stability/com", stability.ComRequest, stability.ComReply, "stability")
STABILITY_WHATIF = Query("stability/whatif", whatif.WhatifRequest, whatif.WhatifReply, "stability")
STABILITY_EQUILIBRIUM = Query(
    "stability/equilibrium", stability.EquilibriumRequest, stability.EquilibriumReply, "stability"
)
STABILITY_CALIBRATE = Query(
    "stability/calibrate", calibration.CalibrateRequest, calibration.CalibrateReply, "stability", acts=True
)
STABILITY_BATCH = Query("stability/batch", whatif.BatchRequest, whatif.BatchReply, "stability")
NAVIGATOR_GOTO = Query("navigator/goto", navigation.GotoRequest, navigation.GoalReply, "navigator", acts=True)
NAVIGATOR_WAYPOINTS = Query(
    "navigator/waypoints", navigation.WaypointsRequest, navigation.GoalReply, "navigator", acts=True
)
NAVIGATOR_CANCEL = Query(
    "navigator/cancel", navigation.CancelRequest, navigation.NavigatorReply, "navigator", acts=True
)
NAVIGATOR_SET_POSE = Query(
    "navigator/set_pose", navigation.SetPoseRequest, navigation.NavigatorReply, "navigator", acts=True
)
NAVIGATOR_MAP = Query("navigator/map", navigation.NavigatorMapRequest, navigation.OccupancyGrid, "navigator")
NAVIGATOR_POLICY = Query("navigator/policy", navigation.PolicyRequest, navigation.PolicyReply, "navigator")
SIM_JOIN = Query("sim/join", system.JoinRequest, system.JoinReply, "driver", acts=True)
SIM_RESET = Query("sim/reset", sim.ResetRequest, sim.ResetReply, "driver", timeout_s=30.0, acts=True)
SIM_STEP = Query("sim/step", sim.StepRequest, sim.SimReply, "driver", acts=True)
SIM_PAUSE = Query("sim/pause", sim.PauseRequest, sim.SimReply, "driver", acts=True)
SIM_SPEED = Query("sim/speed", sim.SpeedRequest, sim.SimReply, "driver", acts=True)
SIM_PUSH = Query("sim/push", sim.PushRequest, sim.SimReply, "driver", acts=True)
SIM_SET = Query("sim/set", sim.SetRequest, sim.SimReply, "driver", acts=True)
SIM_PLACE = Query("sim/place", sim.PlaceRequest, sim.SimReply, "driver", acts=True)
SIM_FAULT = Query("sim/fault", sim.FaultRequest, sim.SimReply, "driver", acts=True)
SIM_CHECKPOINT = Query("sim/checkpoint", sim.CheckpointRequest, sim.CheckpointReply, "driver", acts=True)
SIM_RESTORE = Query("sim/restore", sim.RestoreRequest, sim.CheckpointReply, "driver", acts=True)
SIM_STATUS_GET = Query("sim/status", sim.StatusRequest, sim.SimStatus, "driver")
SIM_EXPERIMENT = Query(
    "sim/experiment", sim.ExperimentRequest, sim.ExperimentReply, "driver", timeout_s=120.0, acts=True
)
SIM_FEATURES = Query("sim/features", sim.FeaturesRequest, sim.FeaturesReply, "driver")
RECORDER_STATUS = Query("recorder/status", system.RecorderRequest, system.RecorderReply, "recorder")
HEALTH_GET = Query("health/*", system.HealthRequest, system.HealthReply, "*", timeout_s=2.0)

_ROWS: list[object] = list(globals().values())
TOPICS: tuple[Topic[Any], ...] = tuple(cast("Topic[Any]", row) for row in _ROWS if isinstance(row, Topic))
QUERIES: tuple[Query[Any, Any], ...] = tuple(cast("Query[Any, Any]", row) for row in _ROWS if isinstance(row, Query))
