"""All numbers of the `best` filter: what the sensors bring, what a robot states, and one set of rates for every robot.

`BestNoise` and `BestLimits` depend on sensors and configuration, `FIXED` on nothing.
"""

import math
from typing import NamedTuple

from ..feet.contact import BestGeometry
from ..params import EstimatorParams, StartPose


class BestNoise(NamedTuple):
    """Noises and rates of the filter, SI; noises of sensors are densities, independent of the rate of a log."""

    gyro: float
    """Noise of the gyro, rad/s/sqrt(Hz)."""
    acc: float
    """Noise of the accelerometer, m/s^2/sqrt(Hz)."""
    sample_gyro: float
    """Noise of one gyro sample, rad/s."""
    sample_acc: float
    """Noise of one accelerometer sample, m/s^2."""
    point: float
    """Noise of a contact point by kinematics, m."""
    stated_point: float
    """Noise of a contact point as it is stated, m, before hypotheses about sliding feet widen it."""
    gyro_bias: float = 2e-4
    """Walk of the gyro bias about level axes, rad/s/sqrt(s)."""
    turn_bias: float = 2e-5
    """Walk of the gyro bias about the vertical, rad/s/sqrt(s): nothing but the feet's twist shows it, so it is slow."""
    acc_bias: float = 3e-4
    """Walk of the accelerometer bias, m/s^2/sqrt(s)."""
    gyro_jerk: float = 0.15
    """Share of the change between two gyro samples that is error: a trunk that shakes bends."""
    turn_jerk: float = 0.05
    """Share of the change about the vertical that is error: a trunk bends back, and the heading adds up over steps."""
    acc_jerk: float = 0.05
    """Share of the change between two accelerometer samples that is error, times sqrt(excess^2 - 1)."""
    stay: float = 0.0002
    """Random walk of a contact point that stays, m/sqrt(s)."""
    slide: float = 0.15
    """Standard deviation of the speed of a point that slides, m/s."""
    carry: float = 0.25
    """Share of the latest sample in the learned velocity of a sliding foot."""
    slip: float = 0.012
    """Deviation of the learned velocity of a sliding foot where each hypothesis has a state of its own, m/s."""
    slip_begin: float = 0.003
    """Probability per sample that a foot begins to slide, where each hypothesis has a state of its own."""
    slip_landing: float = 0.05
    """Probability that a foot slides when it comes down, where each hypothesis has a state of its own."""
    begin_slide: float = 0.6
    """Probability per sample that a point begins to slide: high, for a single point is corrected by both hypotheses."""
    go_on: float = 0.98
    """Probability per sample that a sliding point goes on."""
    learn: float = 0.03
    """Rate at which the excess of the inertial noise follows the innovations, per sample of the feet."""
    rise: float = 1.5
    """Weight of a positive correlation of successive innovations beside a negative one in the growth of the excess."""
    drop: float = 0.35
    """Correlation of successive innovations that is no sign of anything; below it the excess falls."""
    twist: float = 0.1
    """Turning of a standing sole about the vertical, rad/sqrt(s): friction holds it by a small lever only."""
    roll: float = 0.05
    """Turning of a standing sole about its long axis, rad/sqrt(s): the weight that moves across bends leg and sole."""
    pitch: float = 0.002
    """Turning of a standing sole about its short axis, rad/sqrt(s): its length resists."""
    rock: float = 0.5
    """Turning of a sole that stands on an edge or a corner, rad/s."""
    creep: float = 0.008
    """Motion of the edge or corner on which a sole rocks, m/s."""
    most_excess: float = 15.0
    """Largest excess, the factor of the inertial noise over that of the sensor."""
    most_shaken: float = 0.1
    """Largest noise of an accelerometer times excess, m/s^2/sqrt(Hz), unless more is stated: no trunk hides more."""
    lag_s: float = 5.0
    """Time over which corrections of the position are averaged, s."""


class BestLimits(NamedTuple):
    """Settings of the start of the filter and of its detection of rest, SI."""

    samples: int
    """Inertial samples of a rest."""
    gyro_variance: float
    """Largest variance of a gyro axis at rest, (rad/s)^2."""
    acc_variance: float
    """Largest variance of an accelerometer axis at rest, (m/s^2)^2."""
    travel: float
    """Largest move of a foot within a rest, m."""
    gyro_bias_sd: float
    """Standard deviation of an unknown gyro bias, rad/s."""
    acc_bias_sd: float
    """Standard deviation of an unknown accelerometer bias, m/s^2."""
    slope_sd: float
    """Slope of the ground at the start, rad; infinite: unknown."""
    start: StartPose
    """Pose of base_link and height of the ground at the start."""
    start_sd: float
    """Standard deviation of the start pose, m and rad."""
    gap_s: float
    """Step between inertial samples from which uncertainty is added, s."""
    forget_s: float
    """Step between inertial samples from which velocity and feet are unknown, s."""
    max_speed: float
    """Speed from which an estimate is an error, m/s."""
    level_sd: float
    """Standard deviation of a point over level ground, m per sample of the feet; infinite: any ground."""
    hypotheses: bool
    """True if points may slide, by hypotheses."""
    levels: bool
    """Levels on which feet have stood correct the height."""
    creep: float = 0.0025
    """Rate at which a robot at rest may still turn, rad/s: servos settle under its weight."""
    turn_creep: float = 0.0005
    """Rate at which a robot at rest may still turn about the vertical, rad/s: its weight does not turn it."""


class BestSetting(NamedTuple):
    """Geometry, noises and limits of a filter."""

    geometry: BestGeometry
    noise: BestNoise
    limits: BestLimits


class FixedNumbers(NamedTuple):
    """Numbers that are the same for every robot, log and configuration."""

    acc_share: float = 1.2
    """Noise of an accelerometer that walks over that of its data sheet."""
    point_share: float = 1.3
    """Noise of a point that stays by hypothesis over that of a point that may slide at each sample."""
    stated_sd: float = 1e-3
    """Standard deviation of a stated start pose, m and rad."""
    lost_sd: float = 1.0
    """Standard deviation of an unknown pose, m and rad."""
    level_sd: float = 0.01
    """Standard deviation of a point over level ground, m per sample: edges, dust and lifting feet repeat themselves."""
    free: float = 1.0
    """Variance of a point that touches nothing, m^2."""
    least_step: float = 0.025
    """Time after a sample of the feet within which another with the same contacts is left out, s."""
    # corrections by a point
    vertical_slide: float = 0.25
    """Share of the variance of sliding that is vertical."""
    reported_begin: float = 0.01
    """Probability per sample that a foot begins to slide, for the reported probability."""
    reported_on: float = 0.9
    """Probability per sample that a sliding foot goes on, for the reported probability."""
    slides: float = 0.5
    """Probability from which a foot is reported to slide."""
    outlier: float = 16.0
    """Largest chi^2 of 3 degrees of freedom (99.9 %): a larger innovation is an error even of a sliding point."""
    learn_mistrust: float = 0.1
    """Share of one sample in the mistrust in a point."""
    most_mistrust: float = 0.6
    """Mistrust in a point from which its foot is left out."""
    forget_mistrust: float = 0.3
    """Rate at which the mistrust in a foot that is left out fades, 1/s."""
    most_misfits: int = 3
    """Outliers in a row after which a contact point is taken to be somewhere else."""
    surprise_s: float = 0.25
    """Time over which normalised innovations squared of the points are averaged, s."""
    most_surprise: float = 100.0
    """Largest normalised innovation squared of a point that counts in that average."""
    # corrections by all feet
    most_carried: float = 3.0
    """Excess of the inertial noise beyond which the velocity of a slide is hardly learned."""
    swing: float = 0.2
    """Speed of a foot that may be in the air, m/s."""
    longest_gap: float = 0.3
    """Time without a sample of the feet after which any of them may have stepped, s."""
    most_lag: float = 5.0
    """Largest correction of the position that counts as lag of the velocity, in noises of a point: more is a mishap."""
    slide_memory: float = 0.99
    """Share that stays per sample of the sums by which the persistence of slides is learned."""
    slide_trust: float = 1e-4
    """Weight of the prior assumption that slides persist, (m/s)^2."""
    least_persistence: float = 0.3
    """Correlation below which no slide is expected to go on."""
    most_growth: float = 0.1
    """Largest change of the logarithm of the excess by one pair of innovations."""
    # sensors of the legs
    forget_fault: float = 0.15
    """Rate at which the mistrust in a sensor fades, 1/s: from 1 to `most_mistrust` in 3.4 s, longer than two steps."""
    jump: float = 0.015
    """Distance from a smooth way that is a jump of an encoder, m. Clean logs: 12 mm at 55 Hz, 8 at 100, 4 at 200."""
    stand_step: float = 0.04
    """Longest step between samples at which a standing foot follows a smooth way, s."""
    fly_step: float = 0.02
    """Longest step of samples at which a foot in the air follows a smooth way, s: at 33 ms a fast one is 20 mm off."""
    crossed: float = 0.1
    """Share of their squared jumps by which two feet may miss each other's places if they are swapped."""
    turning: float = 0.1
    """Rate of the IMU from which it turns for sure, rad/s."""
    usual_s: float = 1.0
    """Time over which the gyro's mean is taken, s: no offset of a gyro, known or not, turns beside it."""
    most_repeated: float = 0.03
    """Turning of the IMU while only one foot on the ground repeats its sample, rad: frozen. Clean logs: 0.009."""
    longest_repeat: float = 0.1
    """Longest step between two samples of the feet that counts in `most_repeated`, s."""
    longest_held: float = 0.25
    """Time for which slow encoders may repeat all feet, s."""
    strange_s: float = 0.25
    """Time in which what a foot shows beside the inertial unit is forgotten, s: before its bias adds up."""
    longest_compared: float = 0.05
    """Longest step between two samples of the feet over which they are compared, s: in a longer one feet land."""
    most_strange: float = 2.0
    """Change of a foot's velocity between two samples that is a jump and not a motion, m/s."""
    unsure_speed: float = 0.05
    """Speed of a foot that encoders do not distinguish from none, m/s: 1 mm in two samples 25 ms apart."""
    level_share: float = 0.15
    """Weight of level beside vertical motion: feet that touch the ground slide, and do not rise."""
    against_s: float = 0.2
    """Time over which switches and motion are compared, s; one that hangs has not changed for as long."""
    most_more: float = 0.8
    """Largest logarithm of one sample in the mean over `against_s`: two are no sign, a foot that lands may bounce."""
    most_against: float = 0.3
    """Mean logarithm of the ratio of motions from which a switch is wrong; twice that for one alone that changes."""
    most_right: float = 0.5
    """Largest mean logarithm by which motion agrees with a switch of two: what was right before hides no fault long."""
    risen: float = 0.008
    """Rise of one of two feet over the other that shows that it does not stand, m. Clean logs, both closed: 7 mm."""
    lifted: float = 0.003
    """Rise of a foot whose switch is open from which it has been in the air, m."""
    rises_s: float = 0.02
    """Time for which a foot must have risen, two samples at least, s."""
    delay_forget_s: float = 0.25
    """Time in which what a foot shows beside the inertial unit is forgotten where late stamps are looked for, s."""
    delay_s: float = 1.0
    """Time over which late stamps of the feet are looked for, s."""
    delay_least_s: float = 0.5
    """Least time on the ground, of all feet together, from which late stamps are looked for, s."""
    delay_period: float = 0.012
    """Longest step between inertial samples that show late stamps of the feet, s: a Go1 at 55 Hz shows wrong ones."""
    delay_vertical: float = 0.15
    """Weight of vertical beside level motion in the search for late stamps: feet land along it."""
    delay_share: float = 0.3
    """Share of what feet show beside the inertial unit that late stamps explain, from which they are late."""
    delay_lasts_s: float = 0.15
    """Time for which feet must show that they are late, s: one event is no sign."""
    delay_speed: float = 0.012
    """Rms speed that late stamps explain from which feet are late, m/s: robots that sway show 0.006 at most."""
    least_delay_s: float = 0.015
    """Least time by which feet are late, s: walks of clean logs show 0.010 at most."""
    most_delay_s: float = 0.07
    """Largest time by which feet are late, s: no foot moves on a line for longer; feet that roll show 0.08, early."""
    most_late_s: float = 0.15
    """Largest time that is taken off the stamps for the motion of the feet, s: what grows on is something else."""
    legs_s: float = 2.0
    """Time of standing over which the noise of contact points is shown, s."""
    least_legs_s: float = 0.5
    """Least time of standing, of all feet together, that shows the noise of contact points, s."""
    least_way: float = 1e-6
    """Way of a foot between two samples that no encoder shows, m."""
    least_point: float = 2.5e-4
    """Noise of a contact point that legs and soles of no robot are below, m."""
    sure_point: float = 3e-4
    """Stated noise of a contact point up to which it is not doubted, m."""
    more_point: float = 1.2
    """Largest noise of a contact point over that which standing feet show from sample to sample."""
    weight_s: float = 0.05
    """Time over which the accelerometer's length is averaged, s: in flight it falls to nothing as soon."""
    longest_aloft: float = 0.2
    """Time without a closed switch after which the switches of a robot that shows its weight are not believed, s."""
    # heading
    parting: float = 0.02
    """Rate at which standing feet part, 1/s, from which the gyro is believed about the heading more than they are."""
    parting_s: float = 1.5
    """Time of standing over which the rate of parting is averaged, s."""
    least_stood: float = 0.1
    """Shortest standing of the same feet that shows the rate of parting, s."""
    own_sd: float = 0.002
    """Standard deviation of a gyro bias that only parting feet show, rad/s."""
    own_unknown: float = 0.015
    """Bias that no rest has shown from which on the gyro's own cannot be 0, as is assumed until then, rad/s."""
    firm: int = 3
    """Closed switches that hold a sole flat on the ground."""
    # levels of the ground
    settles: float = 0.06
    """Time after which a foot that has come down rests on the ground, s."""
    same_level: float = 0.03
    """Distance in height up to which feet may stand on one level, m."""
    step_sd: float = 0.003
    """Standard deviation of the height of one step on a level, m."""
    least_uneven: float = 0.001
    """Least unevenness of a ground that is known to be flat, m."""
    most_slope: float = 0.02
    """Slope of the ground from which it is no level, rad: 1.1 deg."""
    slope_sd: float = 0.01
    """Standard deviation of the slope before feet have shown it, rad."""
    learn_ground: float = 0.125
    """Share of one step in unevenness and slope."""
    level_gate: float = 4.0
    """Largest normalised distance squared of a step from its level of the ground, 1 degree of freedom (95 %)."""
    # hypotheses about sliding feet
    most_feet: int = 2
    """Most feet of a robot whose sets of sliding feet are hypotheses; of more feet the others show which slides."""
    least_prior: float = 0.01
    """Probability before a sample below which a hypothesis is dropped."""
    least_weight: float = 0.01
    """Probability after a sample below which a hypothesis is dropped."""
    no_share: float = 0.01
    """Share of a mean of hypotheses below which one of them is left out of it."""
    # gaps and losses, beside the constants of `params`
    lost_share: float = 0.2
    """Variance of the mean of lost inertial samples, share of the squared changes of the samples around them."""
    lost_memory: float = 1.0
    """Time over which losses of the velocity are taken together, s."""
    # start
    good_tilt: float = 0.03
    """Standard deviation of the tilt below which a start in motion has settled, rad."""
    good_speed: float = 0.05
    """Standard deviation of the velocity below which a start in motion has settled, m/s."""
    good_age: float = 0.7
    """Time after which a start in motion may have settled, s."""
    fresh_age: float = 2.0
    """Time after a start in motion within which a rest is a better start, s."""
    moving_tilt: float = 0.52
    """Standard deviation of the first tilt of a robot in motion, rad: 30 deg."""
    contradiction: float = 4.0
    """Standard deviations by which the accelerometer at rest may differ from the stated slope, or from the tilt."""
    plane_point: float = 5e-4
    """Distance of a foot of an assembled robot from its model, m."""
    tilted: float = 0.7
    """Mean level acceleration, m/s^2, that shows a wrong tilt of 4 deg at rest or where the velocity is lost."""
    most_noise: float = 1.6
    """Largest stated noise of an inertial sensor that counts, noises of a rest's noisiest axis. Clean logs: 1.56."""
    more_noise: float = 1.3
    """Noise of a rest's middle axis over the stated one from which that counts. Own walks: 1.15."""
    least_noise: float = 0.03
    """Share of the stated noise below which a rest shows the steps of a sensor and not its noise."""
    woken_excess: float = 2.2
    """Excess of the inertial noise just after a rest from which the tilt of the rest is looked at. Clean logs: 2."""
    woken_s: float = 1.0
    """Time after a rest within which the tilt of the rest is looked at, s."""
    woken_least_s: float = 0.2
    """Time after a rest from which the tilt of the rest is looked at, s."""
    woken_speed: float = 0.15
    """Level velocity that the feet have taken out since a rest which shows a wrong tilt, m/s."""
    woken_straight: float = 0.9
    """Share of the square of that velocity that grows with the time by which it is a tilt's. Feet 50 ms late: 0.5."""
    suspected: float = 0.05
    """Mistrust in a sensor of a leg below which it is forgotten: 20 s after a fault."""
    tilted_for: float = 0.1
    """Least time over which the mean level acceleration of `tilted` is taken, s."""
    tilted_sd: float = 0.3
    """Standard deviation of a tilt by the mean accelerometer of a robot in motion, rad."""
    upright: float = 0.76
    """Cosine of the tilt (40 deg) beyond which a robot has fallen, and lost its feet by that."""
    falling: float = 0.1
    """Share by which the mean specific force of a robot that stands may differ from gravity; in a fall it is less."""
    # published pose
    pose_walk: float = 0.001
    """Walk of the position while the excess of the inertial noise is sqrt(2), m/sqrt(s): feet and legs err as well."""
    # poses, headings and velocities from elsewhere
    frame_sd: float = 100.0
    """Standard deviation of the shift of a frame that is unknown, m; it is laid so that its first pose fits."""
    frame_turn_sd: float = 3.0
    """Standard deviation of the turn of a frame that is unknown, rad; it is laid so that its first pose fits."""
    most_jumps: float = 10.0
    """Poses in a row that do not fit after which their frame has jumped: 1 s of a camera."""
    length_sd: float = 0.01
    """Standard deviation of the length of g, m/s^2, which the state takes as known."""


FIXED = FixedNumbers()


def best_noise(params: EstimatorParams, modes: bool = False) -> BestNoise:
    """Return the noises of the filter.

    Args:
        params: of sensors and geometry.
        modes: hypotheses about sliding feet are carried through time (`hypotheses`); else each sample is mixed.
    """
    root, point = math.sqrt(1e-9 * params.imu_period_ns), max(params.sigma_point, FIXED.least_point)
    noise = BestNoise(
        params.sigma_w * root, FIXED.acc_share * params.sigma_q * root, params.sigma_w, params.sigma_q, point, point
    )
    if modes:
        noise = noise._replace(
            point=FIXED.point_share * point, stay=0.0005, gyro_bias=6e-5, gyro_jerk=0.12, turn_jerk=0.12,
            slide=0.04, go_on=0.95,
        )  # fmt: skip
    return noise


def best_limits(params: EstimatorParams, start: StartPose, stated: bool, hypotheses: bool = True) -> BestLimits:
    """Return limits of start and rest of the filter; `stated`: pose and slope at the start are known; else unknown."""
    return BestLimits(
        samples=params.standstill_samples, travel=params.standstill_travel, max_speed=params.max_speed,
        gyro_variance=params.standstill_gyro_sd**2, acc_variance=params.standstill_acc_sd**2,
        gyro_bias_sd=params.gyro_bias_sd, acc_bias_sd=params.acc_bias_sd, hypotheses=hypotheses,
        slope_sd=params.start_slope_sd if stated else math.inf, start=StartPose(*map(float, start)),
        start_sd=FIXED.stated_sd if stated else FIXED.lost_sd, gap_s=params.gap_periods * 1e-9 * params.imu_period_ns,
        forget_s=1e-9 * params.reset_gap_ns, level_sd=FIXED.level_sd if params.level_ground and stated else math.inf,
        levels=params.levels and not (params.level_ground and stated),
    )  # fmt: skip
