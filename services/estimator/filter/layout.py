"""Indices, by name, of the values in the arrays of `BestState`, the state of the `best` filter; K contact points."""

from typing import NamedTuple


class StateLayout(NamedTuple):
    """First index of each part of the state vector `BestState.x`, (21 + 3 K,)."""

    rot: int = 0
    """Index: rot_odom_from_imu, the matrix (3, 3) by rows, (9,)."""
    vel: int = 9
    """Index: velocity of the IMU, odom axes, (3,) m/s."""
    gyro_bias: int = 12
    """Index: bias of the gyro, IMU axes, (3,) rad/s."""
    acc_bias: int = 15
    """Index: bias of the accelerometer, IMU axes, (3,) m/s^2."""
    pos: int = 18
    """Index: position of the IMU in odom, (3,) m."""
    points: int = 21
    """Index: positions of the contact points from the IMU, odom axes, (3,) m each: point k begins at `points` + 3 k. If
    another source gives poses, shift (3,) m and turn, rad, of the frame of these poses against odom follow."""


class ErrorLayout(NamedTuple):
    """First row of each part of the error of the state and of its covariance, (15 + 3 K,)."""

    rot: int = 0
    """Row: rotation of the attitude's error, odom axes, (3,) rad; the third is the heading's."""
    vel: int = 3
    """Row: error of the velocity, odom axes, (3,) m/s."""
    gyro_bias: int = 6
    """Row: error of the gyro bias, IMU axes, (3,) rad/s."""
    acc_bias: int = 9
    """Row: error of the accelerometer bias, IMU axes, (3,) m/s^2."""
    pos: int = 12
    """Row: error of the position, odom axes, (3,) m."""
    points: int = 15
    """Row: errors of the contact points, odom axes, (3,) m each: point k begins at `points` + 3 k."""


class PointLayout(NamedTuple):
    """Columns of the numbers of each contact point in `BestState.points`, (K, 11)."""

    down: int = 0
    """Column: 1 while the point stands on the ground, else 0."""
    slide: int = 1
    """Column: probability that the point slides, 0 to 1, as its last correction weighted it."""
    misfit: int = 2
    """Column: number of samples in a row that were outliers for this point."""
    seen: int = 3
    """Column: probability that the point slides, 0 to 1, as published."""
    new: int = 4
    """Column: 1 until a second sample has confirmed the position at which the point was put down, then 0."""
    along: int = 5
    """Column: velocity of the point's foot if that slides, odom axes, (2,) m/s."""
    stood: int = 7
    """Column: time since the point was put down, s."""
    level: int = 8
    """Column: 1 + index of the known ground level on which the point's foot stands, 0 = not determined yet."""
    closed: int = 9
    """Column: switches of the point's foot that were closed at the last sample, bit s for switch s."""
    mistrust: int = 10
    """Column: fraction of the point's recent samples that were outliers, 0 to 1; it stays when the point is lifted."""


class SensorLayout(NamedTuple):
    """Columns of `BestState.sensors`, one row for each foot: findings about the leg's sensors, and mistrust in them."""

    source: int = 0
    """Column: index of the foot in the samples whose encoders are those of this foot: its own, unless two are
    swapped."""
    trunk: int = 1
    """Column: velocity of the trunk as this foot shows it if it stands, odom axes, (3,) m/s; NaN: not known."""
    strange: int = 4
    """Column: change of the velocity `trunk` beyond what the inertial unit shows, with decay, odom axes, (3,) m/s."""
    against: int = 7
    """Column: mean log ratio by which the foot's motion contradicts its switch; above 0: contradicts, below: agrees."""
    switch: int = 8
    """Column: mistrust in the foot's switch, 0 = none to 1 = full; it decays."""
    jump: int = 9
    """Column: mistrust in the foot's encoders since they jumped, 0 = none to 1 = full; it decays."""
    still: int = 10
    """Column: mistrust in the foot's encoders since they froze, 0 = none to 1 = full; it decays."""
    held: int = 11
    """Column: time for which the foot's samples have repeated one sample to the bit, s."""
    repeated: int = 12
    """Column: angle that the IMU has turned while the foot's samples repeated one sample, rad."""
    firm: int = 13
    """Column: number of compared samples in a row at which the foot stood."""
    same: int = 14
    """Column: time for which the foot's switch has been closed (positive) or open (negative), s."""
    leap: int = 15
    """Column: usual distance by which the foot's encoders jump when its switch changes, m."""
    compared: int = 16
    """Column: value of column `source` (index of a foot) at the last sample whose motion was compared."""
    wired: int = 17
    """Column: index of the foot in the samples whose switches are those of this foot: its own, unless two are
    swapped."""
    delay: int = 18
    """First column of the values that show if the foot's samples have late stamps, laid out as in `DelayLayout`."""


class DelayLayout(NamedTuple):
    """Columns of a foot's row of `BestState.sensors` from `SensorLayout.delay` on, for the search for late stamps.

    R is rot_odom_from_imu, w the gyro, y the foot from the IMU; all vectors in odom axes.
    """

    shown: int = 0
    """Column: velocity of the trunk by this foot at the middle of the last step, plus what the inertial unit gained
    since, odom axes, (3,) m/s."""
    moved: int = 3
    """Column: velocity R (w x y) by the trunk's turning at the middle of the last step, less what the inertial unit
    gained since, odom axes, (3,) m/s."""
    rate: int = 6
    """Column: derivative of the velocity v + R (w x y) that the joints show, v by the inertial unit, odom axes, (3,)
    m/s^2."""
    strange: int = 9
    """Column: velocity of the trunk by the foot less that by the inertial unit since landing, decaying, odom axes, (3,)
    m/s."""
    due: int = 12
    """Column: expected change of `strange` per second by which stamps are early, with equal decay, odom axes, (3,)
    m/s^2."""
    sums: int = 15
    """Column: integrals of `strange` `due`, `due`^2, `strange`^2 and 1 over the time that the foot stood, with decay,
    (4,)."""
    stood: int = 19
    """Column: number of samples in a row at which the foot stood."""


class HeightLayout(NamedTuple):
    """Indices, from `MemoryLayout.heights` on, of values about the height of foot 0 of a biped over foot 1."""

    over: int = 0
    """Index: learned height of foot 0 over foot 1 while both stand, m."""
    known: int = 1
    """Index: 1 while `over` is known, else 0."""
    other: int = 2
    """Index: height of foot 0 over foot 1, m, different from `over`, that the feet show since both came to stand."""
    steady: int = 3
    """Index: time for which the feet have shown the height `other`, s."""
    closed: int = 4
    """Index: switches closed at the last sample with any closed, bit f for foot f; -1: encoders were wrong at that
    sample."""
    opened: int = 5
    """Index: largest height of the foot with the open switch over the other foot since the switch opened, m."""
    alike: int = 6
    """Index: 1 if the last sample contradicted the switches, else 0: a single contradiction may be a jump."""
    lasts: int = 7
    """Index: time for which samples in a row have contradicted the switches, s."""


class MemoryLayout(NamedTuple):
    """First index of each part of `BestState.memory`, (124,)."""

    excess: int = 0
    """Index: excess, the factor of the inertial noise over that of the sensor, at least 1."""
    innovation: int = 1
    """Index: last innovation that all points have in common (mean over the points), odom axes, (3,) m."""
    last_gyro: int = 4
    """Index: last gyro sample, IMU axes, (3,) rad/s."""
    since: int = 7
    """Index: time since the last sample of the feet, s; -1 (`NO_FEET`) before the first."""
    nis: int = 8
    """Index: normalised innovation squared of the points, mean over `FixedNumbers.surprise_s`, 3 degrees of freedom."""
    phase: int = 9
    """Index: phase of the start: `WAITING` = 0, `MOVING` = 1, `STARTED` = 2, `DOUBTED` = 3 or `CERTAIN` = 4."""
    rest: int = 10
    """Index: number of inertial samples at rest in a row."""
    age: int = 11
    """Index: time since the start of the filter, s."""
    lag: int = 12
    """Index: lag of the velocity, a correction that is added to the velocity when it is published, IMU axes, (3,)
    m/s."""
    losses: int = 15
    """Index: number of times that the velocity was lost: no contact point fitted for several samples."""
    lost_for: int = 16
    """Index: time since the velocity was lost, s; -1 (`LONG_AGO`) when there is nothing to compare."""
    push: int = 17
    """Index: velocity change by the inertial unit alone since the velocity was lost, or since `woke`, odom axes, (3,)
    m/s."""
    unfit: int = 20
    """Index: number of samples of the feet in a row of which no point fitted."""
    slide_product: int = 21
    """Index: sum with decay of m.s, (m/s)^2: m the slide velocity of a sample, s the one that was learned before it."""
    slide_square: int = 22
    """Index: sum with decay of s.s, (m/s)^2: s the slide velocity that was learned before each sample."""
    last_acc: int = 23
    """Index: last accelerometer sample, IMU axes, (3,) m/s^2."""
    own_bias: int = 26
    """Index: gyro bias that the last rest showed, IMU axes, (3,) rad/s; 0 before the first."""
    stood: int = 29
    """Index: points that stood at the last sample of the feet, bit k for point k; 0 if they are all of one foot."""
    stood_since: int = 30
    """Index: value of `age`, s, when the points of `stood` came to stand together."""
    apart: int = 31
    """Index: mean square distance of the points of `stood` from their centroid when they came to stand together,
    m^2."""
    rate: int = 32
    """Index: rate at which the points of `stood` have parted (grown apart) since they came to stand together, 1/s."""
    parting: int = 33
    """Index: mean square of the rates at which standing points have parted (grown apart), 1/s^2."""
    framed: int = 34
    """Index: 1 while the frame of poses of another source (camera, GNSS) is known, else 0."""
    jumps: int = 35
    """Index: number of poses of another source in a row that were left out."""
    left_out: int = 36
    """Index: number of samples of another source in a row that were left out."""
    externals: int = 37
    """Index: number of samples of another source so far."""
    externals_out: int = 38
    """Index: number of samples of another source that were left out so far."""
    frames: int = 39
    """Index: number of times that the frame of another source's poses was determined."""
    pose_extra: int = 40
    """Index: covariance Q of the published pose beyond the filter's: XX, XY, YY, XT, YT, TT, ZZ, T the heading,
    (7,)."""
    uneven: int = 47
    """Index: mean square distance in height of feet that stand on one level of the ground, m^2."""
    slope: int = 48
    """Index: sums with decay of x^2, x y, y^2, x z, y z over pairs of feet on one level, (x, y, z) from one to the
    other, (5,) m^2."""
    watched: int = 53
    """Index: number of samples of the feet since the motion of the feet was last compared with their switches."""
    usual_gyro: int = 54
    """Index: mean of the gyro over the last `FixedNumbers.usual_s`, IMU axes, (3,) rad/s."""
    ran: int = 57
    """Index: difference of `push` from the velocity at `FixedNumbers.tilted_for` after the loss, odom axes, (3,)
    m/s."""
    woke: int = 60
    """Index: value of `age`, s, at the last quiet sample of a rest; -1 (`LONG_AGO`) when there is nothing left to
    compare."""
    shown: int = 61
    """Index: factors of the stated noise of gyro and accelerometer by the rest of the start, and of a contact point by
    the feet that stand, (3,)."""
    legs: int = 64
    """Index: decaying integrals over the time that feet stand, of the log of the noise, m, that they show, and of 1,
    (2,)."""
    weight: int = 66
    """Index: norm of the accelerometer's samples, mean over `FixedNumbers.weight_s`, m/s^2."""
    aloft: int = 67
    """Index: time for which all switches have been open while the accelerometer shows the weight, s."""
    wrong: int = 68
    """Index: fit of a line through 0 to the level part d of `push` less the velocity that a standing foot shows, over
    the time t since `woke`: integrals of t d (2), t^2 and d^2, (4,)."""
    heights: int = 72
    """First index of the values about the height of one foot of a biped over the other, laid out as in
    `HeightLayout`."""
    levels: int = 80
    """Index: known levels of the ground, four numbers each: height, m, its variance, m^2, number of steps on it, `age`
    at the last, s."""
    carried: int = 112
    """Index: angle, rad, by which the robot has turned with still legs since all its switches opened, less that by
    which it turned with legs that moved."""
    sunk: int = 113
    """Index: decaying sums of the heights by which feet landed above the landing before, m, and of the times between,
    s, (2,); the ratio is the speed at which feet sink."""
    landed: int = 115
    """Index: height of the ground in odom under the foot that landed last, m, as long as it stands."""
    landed_at: int = 116
    """Index: value of `age`, s, at that time; 0 before any has landed."""
    landed_foot: int = 117
    """Index: that foot's number + 1 while it stands, else 0."""
    sinks: int = 118
    """Index: speed at which feet sink, m/s; 0: they do not; below 0: they rise."""
    level_way: int = 119
    """Index: level part of the way over ground that was taken to be level, odom axes, (2,) m."""
    landed_pos: int = 121
    """Index: place of the IMU in odom when the last foot landed, level part, (2,) m."""
    levelled: int = 123
    """Index: 1 if the foot that landed last was put on a level of the ground; it fades with landings on none."""


LEVEL, LEVELS = 4, 8
"""`LEVEL`: number of values stored for a ground level; `LEVELS`: largest number of levels that are stored."""
X, E, P, S, L = StateLayout(), ErrorLayout(), PointLayout(), SensorLayout(), DelayLayout()
H, M = HeightLayout(), MemoryLayout()
POINT_COLUMNS, SENSOR_COLUMNS, MEMORY = P.mistrust + 1, S.delay + L.stood + 1, M.levelled + 1
HEIGHTS = H.lasts + 1
"""`POINT_COLUMNS`, `SENSOR_COLUMNS`: number of columns of `BestState.points` and `BestState.sensors`; `MEMORY`: length
of `BestState.memory`; `HEIGHTS`: length of its part `heights`."""
WAITING, MOVING, STARTED, DOUBTED, CERTAIN = 0.0, 1.0, 2.0, 3.0, 4.0
"""Phases of the start: `WAITING`: not started; `MOVING`: in motion, too uncertain to be used; `CERTAIN`: in motion and
usable, a rest soon after starts it anew; `DOUBTED`: too uncertain again, its tilt proved wrong;
`STARTED`: usable and kept, after a rest or a longer motion."""
NO_FEET = LONG_AGO = -1.0
"""Markers, s, of times that are not defined: no sample of the feet yet (`NO_FEET`), no such event (`LONG_AGO`)."""
