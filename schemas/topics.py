"""THE table of topics and queries: one row per key, typed by the model it carries.

Keys are relative to the session namespace ``<fleet>/<robot>``. A key that ends in ``/*`` is a family with one member
per service; ``of(service)`` names the member. Each topic states its rate once, in Hz; periods, limits of lateness, the
simulator's sensors and docs/topics.md follow from it.
"""

from typing import TYPE_CHECKING, Any, cast

from .rows import TICK_HZ, TICK_KEY, Kind, ModelPlaces, Query, Topic
from .rows import TICK_NS as TICK_NS
from .rows import TICK_S as TICK_S

if TYPE_CHECKING:
    from . import calibration, cmd, footholds, hw, navigation, sim, stability, state, status, system, terrain, whatif
else:  # the same names at run time: a row names its model, and the first use of the row imports it
    for _file in (
        "calibration", "cmd", "footholds", "hw", "navigation", "sim", "stability", "state", "status", "system",
        "terrain", "whatif",
    ):  # fmt: skip
        globals()[_file] = ModelPlaces(_file)

EVENT = 0.0
"""Rate that marks a topic as published on events, without a period."""
KINEMATICS_HZ = 1000.0 / 33.0
"""Rate of encoders and foot switches, Hz (Bioloid bus of Wawrzynski et al.: one sample in 33 ms); the period in ns is
rounded to 33_000_000."""
VARIANT_HZ = 20.0
"""Rate at which the variants of the estimators are published, Hz; the estimators themselves run at full rate."""


# hardware contract: a driver provides hw/*, consumes cmd/*
HW_TICK = Topic(TICK_KEY, hw.Tick, Kind.LOCKSTEP, "driver", TICK_HZ, deterministic=False)
HW_IMU = Topic("hw/imu", hw.Imu, Kind.SAMPLE, "driver", 100.0)
HW_JOINTS = Topic("hw/joints", hw.JointState, Kind.SAMPLE, "driver", KINEMATICS_HZ)
HW_CONTACTS = Topic("hw/contacts", hw.FootContacts, Kind.SAMPLE, "driver", KINEMATICS_HZ)
HW_LANDMARKS = Topic(
    "hw/landmarks", hw.LandmarkDetections, Kind.SAMPLE, "driver", 10.0, own_rate="`period_ms` of the camera's file"
)
HW_IMAGE = Topic(
    "hw/image",
    hw.CameraImage,
    Kind.SAMPLE,
    "driver",
    10.0,
    own_rate="`period_ms` of the camera's file",
    deterministic=False,
)
HW_RANGE = Topic("hw/range", hw.Range, Kind.SAMPLE, "driver", 10.0, own_rate="`period_ms` of the ranger's file")
HW_DEPTH = Topic(
    "hw/depth",
    hw.DepthImage,
    Kind.SAMPLE,
    "driver",
    5.0,
    own_rate="`period_ms` of the depth camera's file",
    deterministic=False,
)
HW_EXTERNAL = Topic("hw/external", hw.ExternalMotion, Kind.SAMPLE, "driver", 10.0, own_rate="the driver of the source")
HW_MAKER = Topic("hw/maker", hw.MakerMotion, Kind.SAMPLE, "driver", 50.0, own_rate="the driver of the robot")
TERRAIN_MAP = Topic("terrain/map", terrain.HeightMapMessage, Kind.LATCHED, "driver", EVENT)
TERRAIN_LANDMARKS = Topic("terrain/landmarks", terrain.LandmarkMap, Kind.LATCHED, "driver", EVENT)
CMD_JOINTS = Topic("cmd/joints", hw.JointCommand, Kind.COMMAND, "walker", TICK_HZ)
CMD_ESTOP = Topic("cmd/estop", hw.EmergencyStop, Kind.ALARM, "*", EVENT, deterministic=False)

# functions
STATE_VELOCITY = Topic("state/velocity", state.VelocityEstimate, Kind.STATE, "estimator", TICK_HZ)
STATE_VELOCITY_IMU = Topic("state/velocity/imu", state.VelocityEstimate, Kind.STATE, "estimator", VARIANT_HZ)
STATE_VELOCITY_KINEMATICS = Topic(
    "state/velocity/kinematics", state.VelocityEstimate, Kind.STATE, "estimator", VARIANT_HZ
)
STATE_VELOCITY_KINEMATICS_GYRO = Topic(
    "state/velocity/kinematics_gyro", state.VelocityEstimate, Kind.STATE, "estimator", VARIANT_HZ
)
STATE_VELOCITY_EKF = Topic("state/velocity/ekf", state.VelocityEstimate, Kind.STATE, "estimator", VARIANT_HZ)
STATE_ODOMETRY = Topic("state/odometry", state.Odometry, Kind.STATE, "estimator", TICK_HZ)
STATE_GAIT = Topic("state/gait", state.GaitState, Kind.STATE, "walker", TICK_HZ)
STATE_LANDMARKS = Topic("state/landmarks", state.SeenLandmarks, Kind.STATE, "vision", 20.0)
STATE_ELEVATION = Topic("state/elevation", terrain.ElevationMap, Kind.STATE, "mapper", 2.5)
STATE_STABILITY = Topic("state/stability", stability.StabilityStatus, Kind.STATE, "stability", 50.0)
FOOTHOLDS_CHOSEN = Topic(
    "footholds/chosen", footholds.FootholdChoice, Kind.STATUS, "footholds", EVENT, deterministic=False
)
STATE_POSE = Topic("state/pose", navigation.PoseBelief, Kind.STATE, "navigator", 10.0)
NAVIGATOR_ORDER = Topic("navigator/order", navigation.MotionOrder, Kind.STATE, "navigator", TICK_HZ)
NAVIGATOR_FEEDBACK = Topic("navigator/feedback", navigation.NavigationFeedback, Kind.STATE, "navigator", 10.0)

# simulation only
SIM_TRUTH = Topic("sim/truth", sim.Truth, Kind.SAMPLE, "driver", TICK_HZ, observers_only=True)
SIM_STATUS = Topic("sim/status", status.SimStatus, Kind.STATUS, "driver", EVENT, deterministic=False)

# runtime
TICK_DONE = Topic("tick/*", system.Done, Kind.LOCKSTEP, "*", EVENT, deterministic=False)
HEALTH = Topic("health/*", system.Health, Kind.STATUS, "*", 1.0, deterministic=False)
LOG = Topic("log/*", system.LogRecord, Kind.STATUS, "*", EVENT, deterministic=False)
SUPERVISOR_STATUS = Topic(
    "supervisor/status", system.SupervisorStatus, Kind.STATUS, "supervisor", 1.0, deterministic=False
)

# queries
CMD_WALK = Query("cmd/walk", cmd.WalkCommand, cmd.WalkReply, "walker", acts=True)
HW_DESCRIPTION = Query("hw/description", hw.DescriptionRequest, hw.DescriptionReply, "driver")
TERRAIN_MAP_GET = Query("terrain/map", terrain.MapRequest, terrain.HeightMapMessage, "driver")
TERRAIN_LANDMARKS_GET = Query("terrain/landmarks", terrain.MapRequest, terrain.LandmarkMap, "driver")
FOOTHOLDS_SELECT = Query("footholds/select", footholds.SelectRequest, footholds.SelectReply, "footholds")
FOOTHOLDS_BATCH = Query("footholds/batch", footholds.FootholdsBatchRequest, footholds.FootholdsBatchReply, "footholds")
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
NAVIGATOR_DOCK = Query("navigator/dock", navigation.DockRequest, navigation.GoalReply, "navigator", acts=True)
NAVIGATOR_CANCEL = Query(
    "navigator/cancel", navigation.CancelRequest, navigation.NavigatorReply, "navigator", acts=True
)
NAVIGATOR_PAUSE = Query(
    "navigator/pause", navigation.PauseGoalRequest, navigation.NavigatorReply, "navigator", acts=True
)
NAVIGATOR_RESUME = Query(
    "navigator/resume", navigation.ResumeGoalRequest, navigation.NavigatorReply, "navigator", acts=True
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
SIM_STATUS_GET = Query("sim/status", status.StatusRequest, status.SimStatus, "driver")
SIM_EXPERIMENT = Query(
    "sim/experiment", sim.ExperimentRequest, sim.ExperimentReply, "driver", timeout_s=120.0, acts=True
)
SIM_FEATURES = Query("sim/features", sim.FeaturesRequest, sim.FeaturesReply, "driver")
RECORDER_STATUS = Query("recorder/status", system.RecorderRequest, system.RecorderReply, "recorder")
RECORDER_SAVE = Query("recorder/save", system.SaveRequest, system.SaveReply, "recorder", acts=True)
HEALTH_GET = Query("health/*", system.HealthRequest, system.HealthReply, "*", timeout_s=2.0)
CONFIG_GET = Query("config/*", system.ConfigRequest, system.ConfigReply, "*")
CONFIGURE = Query("configure/*", system.ConfigureRequest, system.ConfigReply, "*", acts=True)

_ROWS: list[object] = list(globals().values())
TOPICS: tuple[Topic[Any], ...] = tuple(cast("Topic[Any]", row) for row in _ROWS if isinstance(row, Topic))
QUERIES: tuple[Query[Any, Any], ...] = tuple(cast("Query[Any, Any]", row) for row in _ROWS if isinstance(row, Query))
