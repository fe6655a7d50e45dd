"""Requests to the foothold service: footholds, scored ground, slip models.

Points named ``foot centre`` are centres of the foot sphere, the input of inverse kinematics. ``contact`` is the point
of the ground under it, one foot radius below along the normal.
"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import MAX_FEET, Bulk, Message, QuatWxyz, Reply, Request, TickRequest, Vec2, Vec3

MAX_WINDOW = 301
MAX_STEPS = 64
"""Largest number of steps in one batch of footholds; a longer batch is refused."""
LayerName = Literal["z", "centre", "k1", "k2", "cos_k3", "k4", "p", "q", "mask", "spread", "support", "clear"]
FootholdStatus = Literal["ok", "raise_trunk", "infeasible"]


class BasePose(Request):
    """Pose of base_link when the feet land, frame map."""

    position: Vec3 = Field(description="origin of base_link, frame map, m")
    quat_wxyz: QuatWxyz = Field(default=(1.0, 0.0, 0.0, 0.0), description="rotates base_link to map, order w x y z")


class LegRequest(Request):
    """Leg that is about to land: name, nominal foothold and stroke."""

    leg: str = Field(min_length=1, max_length=32, description="name of the leg in the robot description, e.g. lf")
    nominal: Vec3 = Field(
        description="foot centre the gait would land on, frame map, m; x and y count, the height comes from the map"
    )
    stroke: Vec3 = Field(
        description="movement of the foot relative to the body during the coming stance, map axes, m; backward when "
        "walking forward"
    )


class StanceOutcome(Request):
    """Outcome of an earlier foothold, from which a model is learned again."""

    leg: str = Field(min_length=1, max_length=32, description="name of the leg in the robot description")
    foothold: Vec2 = Field(description="x, y of the foothold that was chosen, frame map, m")
    nominal: Vec2 = Field(description="x, y of the nominal foothold of that choice, m")
    stroke: Vec3 = Field(description="movement of the foot relative to the body in that stance, map axes, m")
    slip: float = Field(description="way the foot slid over the stance as the robot measured it, m")
    healthy: bool = Field(
        default=True, description="False: an encoder or foot switch of the leg was at fault; nothing is learned from it"
    )


class SelectRequest(TickRequest):
    """Request of the footholds of all legs that land together.

    With ``tick`` the reply rests on the map of that tick, whatever arrives first, so that runs repeat.
    """

    schema_version: ClassVar[str] = "1.3"
    base: BasePose = Field(description="where base_link will be when the feet land")
    legs: Annotated[tuple[LegRequest, ...], Field(min_length=1, max_length=MAX_FEET)] = Field(
        description="one entry for each landing leg, answered in the same order"
    )
    mode: Literal["robust", "paper", "random"] = Field(
        default="robust",
        description="robust: best mean over the landing error of the model, or over 3x3 cells; paper: best single cell "
        "(Walas & Belter, 3.3); random: a free cell at random, needs seed",
    )
    seed: int | None = Field(
        default=None, ge=0, lt=2**63, description="of the draw of mode random: equal seeds, equal cells"
    )
    outcomes: Annotated[tuple[StanceOutcome, ...], Field(max_length=4 * MAX_FEET)] = Field(
        default=(), description="stances that have ended since the request before; used where re-learning is on"
    )


class MaskCounts(Reply):
    """Number of cells of the window that each reason excludes; a cell may have several reasons."""

    reach: int = Field(default=0, ge=0, description="cells the leg cannot reach with margin, at landing or lift-off")
    collision: int = Field(default=0, ge=0, description="cells where the foot wedges or the leg cuts the ground")
    unknown: int = Field(default=0, ge=0, description="cells with an unknown 3x3 neighbourhood or outside the model")
    steep: int = Field(default=0, ge=0, description="cells on ground steeper than the limit")
    slip: int = Field(default=0, ge=0, description="cells with a predicted slip over the limit")
    unlearned: int = Field(default=0, ge=0, description="cells outside what the slip model has learned")
    free: int = Field(default=0, ge=0, description="cells with no reason against them")


class LegFoothold(Reply):
    """Foothold of one leg with its cost and slip, or the reason why there is none."""

    leg: str = Field(description="name of the leg, as asked")
    status: FootholdStatus = Field(
        description="ok; raise_trunk: only with the trunk moved by trunk_shift; infeasible: no cell will do"
    )
    foothold: Vec3 | None = Field(
        default=None, description="chosen foot CENTRE on landing, frame map, m; null when infeasible"
    )
    contact: Vec3 | None = Field(
        default=None, description="ground contact point = foot centre - foot radius * normal, frame map, m"
    )
    normal: Vec3 | None = Field(default=None, description="unit normal of the ground there, map axes")
    trunk_shift: float = Field(
        default=0.0, description="signed change of trunk height that makes the foothold reachable, m; 0 when ok"
    )
    score: float | None = Field(
        default=None,
        description="Q of the chosen cell, by which it was chosen, no unit: P + k K4, unknown ground under the "
        "foot as P = 1; without landing error of the model the mean of it over the free cells of 3x3; small is good",
    )
    slip: float | None = Field(
        default=None, description="P over where the foot may land: way slipped per stroke, 0 to 1, no unit"
    )
    spread: float | None = Field(
        default=None, description="standard deviation of the slip of single stances there, per stroke; null = not known"
    )
    offset: Vec2 | None = Field(default=None, description="foothold minus nominal, map axes x and y, m")
    counts: MaskCounts = Field(default_factory=MaskCounts, description="cells excluded, by reason")
    reason: str = Field(default="", description="why the foothold is not ok, in words")


class SelectReply(Reply):
    """Reply to `footholds/select`: footholds in the order of the legs of the request."""

    schema_version: ClassVar[str] = "1.2"
    legs: tuple[LegFoothold, ...] = Field(description="one answer for each leg asked about")
    map_version: int = Field(ge=0, description="version of the terrain map the answer rests on")
    model: str = Field(description="name of the slip model the answer rests on")
    model_tick: int | None = Field(
        default=None, description="tick of the first request this model answered; null = that request named none"
    )
    explored: bool = Field(default=False, description="the footholds were drawn at random, to learn from them")


class PlannedStep(Request):
    """Legs that land together in a planned step, and the pose of the trunk at that time."""

    base: BasePose = Field(description="where base_link will be when the feet land")
    legs: Annotated[tuple[LegRequest, ...], Field(min_length=1, max_length=MAX_FEET)] = Field(
        description="one entry for each landing leg, answered in the same order"
    )


class FootholdsBatchRequest(TickRequest):
    """Request of the footholds of many steps at once, for planners: nothing is learned or drawn, no choice published.

    Answered beside the ticks, from the map and the slip model at the time of the request.
    """

    steps: Annotated[tuple[PlannedStep, ...], Field(min_length=1, max_length=MAX_STEPS)] = Field(
        description="each for itself, answered in the same order"
    )
    mode: Literal["robust", "paper"] = Field(default="robust", description="as of footholds/select")


class RegionFoothold(LegFoothold):
    """The foothold of one leg, and the convex free ground about it."""

    region: tuple[Vec2, ...] = Field(
        default=(),
        description="corners x, y of the largest rectangle of free cells of the window that holds the foothold, "
        "counterclockwise, map frame, m; between centres of cells, so a line or point where one cell is free; of the "
        "trunk moved by trunk_shift; empty when infeasible",
    )


class StepFootholds(Reply):
    """Footholds of one step in the order of its legs."""

    legs: tuple[RegionFoothold, ...] = Field(description="one answer for each leg asked about")


class FootholdsBatchReply(Reply):
    """Reply to `footholds/batch`: footholds of each step, in the order of the steps of the request."""

    steps: tuple[StepFootholds, ...] = Field(description="one answer for each step")
    map_version: int = Field(ge=0, description="version of the terrain map the answer rests on")
    model: str = Field(description="name of the slip model the answer rests on")


class FootholdChoice(Message):
    """Footholds that the service chose last, as `footholds/select` returned them; for views and recordings."""

    legs: Annotated[tuple[LegFoothold, ...], Field(max_length=MAX_FEET)] = Field(
        description="one entry for each leg of the request"
    )
    model: str = Field(description="name of the slip model the choice rests on")
    explored: bool = Field(default=False, description="the footholds were drawn at random, to learn from them")


class AssessRequest(TickRequest):
    """Request of the scored ground: a window, or the whole map."""

    schema_version: ClassVar[str] = "1.2"
    centre: Vec2 | None = Field(
        default=None, description="x, y of the window's centre and K4's zero, frame map, m; null = the whole map"
    )
    size: int = Field(default=15, ge=1, le=MAX_WINDOW, description="cells along an edge of the window, odd")
    stroke: Vec3 = Field(
        default=(-0.05, 0.0, 0.0), description="movement of the foot relative to the body in stance, map axes, m"
    )
    leg: str | None = Field(
        default=None, max_length=32, description="leg for the reach and collision masks; null = neither is tested"
    )
    base: BasePose | None = Field(default=None, description="pose of base_link at landing; needed with leg")
    layers: Annotated[tuple[LayerName, ...], Field(min_length=1, max_length=9)] = Field(
        default=("k1", "k2", "cos_k3", "p", "q", "mask"), description="what to return, in this order"
    )


class AssessReply(Bulk):
    """Layers of the scored ground: float32 little-endian, C order ``layer[row = y, col = x]``, NaN = unknown.

    k1, k2, k4 and heights in m; cos_k3, p, q without unit; mask holds the sum of the bits of ``mask_bits``; spread is
    the standard deviation of the slip of single stances, per stroke; support is 1 where the slip was learned from many
    stances alike, 0 where it is that of a simple rule; clear, m, is the radius of the free disc about a cell: all cells
    whose centres are nearer have mask 0 and are in the window. The choice of footholds/select about the same centre,
    with the same leg and base, is the cell with mask 0 and the least q.
    """

    schema_version: ClassVar[str] = "1.2"
    layers: tuple[str, ...] = Field(description="names of the layers in the payload, in order")
    rows: int = Field(gt=0, description="cells along y")
    cols: int = Field(gt=0, description="cells along x")
    cell: float = Field(gt=0, description="edge of a cell, m")
    origin: Vec2 = Field(description="x, y of the CENTRE of cell [0, 0], frame map, m")
    mask_bits: dict[str, int] = Field(description="value of each reason in the mask layer")
    counts: MaskCounts = Field(description="cells excluded, by reason")
    map_version: int = Field(ge=0, description="version of the terrain map the answer rests on")
    model: str = Field(description="name of the slip model the answer rests on")

    def data_bytes(self) -> int:
        """Return the length of the raw layers by the other fields of the reply, bytes."""
        return 4 * len(self.layers) * self.rows * self.cols


class ModelRequest(TickRequest):
    """Request of the slip model in force, or of another one in its place."""

    use: str = Field(
        default="",
        max_length=4096,
        description="path of a model file on the machine of the service, hand-made, or shipped (that of the robot); "
        "empty = change nothing",
    )


class ModelReply(Reply):
    """Slip model in use by the foothold service, and the state of its re-learning."""

    schema_version: ClassVar[str] = "1.1"
    model: str = Field(description="name, as in the replies of footholds/select")
    robot: str = Field(default="", description="robot it was learned with; empty = any")
    cell: float | None = Field(default=None, description="edge of a cell it holds for, m; null = any")
    distance_weight: float = Field(description="k of Q = P + k K4 in use, 1/m")
    landing_error: float = Field(description="standard deviation of the landings P is averaged over, m; 0 = 3x3 cells")
    terms: int = Field(default=0, ge=0, description="terms of the sum; 0 = not a learned model")
    samples: int = Field(default=0, ge=0, description="stances it was learned from")
    error: float | None = Field(default=None, description="root mean square error on trials held back, slip per stroke")
    provenance: tuple[str, ...] = Field(default=(), description="where the samples came from")
    unfit: str = Field(default="", description="why the map in force is answered by the hand-made score instead")
    outcomes: int = Field(default=0, ge=0, description="outcomes of stances taken in for re-learning since the start")
    refused: dict[str, int] = Field(default_factory=dict, description="outcomes, rounds and model files refused")


class LearnRequest(Request):
    """Request to start, read or cancel the learning of a slip model from a file of samples; one job at a time."""

    schema_version: ClassVar[str] = "2.0"
    action: Literal["status", "start", "cancel"] = Field(default="status", description="what to do; result: see status")
    samples: str = Field(default="", max_length=4096, description="start: path of the file of samples")
    out: str = Field(default="", max_length=4096, description="start: path of the model file to write; empty = none")
    title: str = Field(default="learned", min_length=1, max_length=64, description="start: name of the model")
    use: bool = Field(default=False, description="start: put the model in force when it is learned")
    folds: int = Field(default=5, ge=2, le=100, description="start: of the choice of size, whole trials each")
    seed: int = Field(default=0, ge=0, lt=2**63, description="start: equal samples and seed, equal bytes")
    distance_weight: float = Field(default=0.5, ge=0, le=1000, description="start: k of the model, 1/m")
    landing_error: float = Field(default=0.005, ge=0, le=0.03, description="start: of the model, m")
    terms: int | None = Field(
        default=None, ge=1, le=1000, description="start: Gaussians of the sum; null = several, chosen by the folds"
    )


class LearnReply(Reply):
    """State of the last job that learned a slip model."""

    schema_version: ClassVar[str] = "1.1"

    state: Literal["idle", "running", "done", "failed", "cancelled"] = Field(description="idle: there was none yet")
    job: int = Field(default=0, ge=0, description="number of the job in this process, from 1")
    progress: float = Field(default=0.0, ge=0, le=1, description="share that is done")
    samples: int = Field(default=0, ge=0, description="stances that are learned from")
    refused: dict[str, int] = Field(default_factory=dict, description="samples left out, by reason")
    model: str = Field(default="", description="done: name of the model")
    error: float | None = Field(default=None, description="done: root mean square error on trials held back")
    code: str = Field(default="", description="failed: code of the reason")
    reason: str = Field(default="", description="failed: the reason in words")
    better: bool | None = Field(
        default=None, description="done: better on grounds held back than the hand-made score and the flattest cell"
    )
    warning: str = Field(default="", description="done: why the model is not better, in words; empty = it is")
