"""All numbers of the `best` filter: noises of sensors, limits of start and rest, and numbers equal for all robots.

`BestNoise` and `BestLimits` depend on sensors and configuration, `FIXED` on nothing.
"""

from typing import NamedTuple

from ..feet.contact import BestGeometry
from ..params import StartPose


class BestNoise(NamedTuple):
    """Noises and rates of the filter, SI; noises of sensors are densities, independent of the rate of a log."""

    gyro: float
    """Noise density of the gyro, rad/s/sqrt(Hz)."""
    acc: float
    """Noise density of the accelerometer, m/s^2/sqrt(Hz)."""
    sample_gyro: float
    """Standard deviation of one gyro sample, rad/s."""
    sample_acc: float
    """Standard deviation of one accelerometer sample, m/s^2."""
    point: float
    """Standard deviation of the position of a contact point by kinematics, m."""
    stated_point: float
    """Stated standard deviation of a contact point by kinematics, m, before hypotheses about sliding feet widen it."""
    gyro_bias: float = 2e-4
    """Random walk of the gyro bias about level axes, rad/s/sqrt(s)."""
    turn_bias: float = 2e-5
    """Random walk of the gyro bias about the vertical, rad/s/sqrt(s): only the feet's twist shows it, so it is slow."""
    acc_bias: float = 3e-4
    """Random walk of the accelerometer bias, m/s^2/sqrt(s)."""
    gyro_jerk: float = 0.15
    """Fraction of the change between two gyro samples that is error about level axes: a shaken trunk bends."""
    turn_jerk: float = 0.05
    """Fraction of the change between two gyro samples about the vertical that is error; the heading sums it up."""
    acc_jerk: float = 0.05
    """Fraction of the change between two accelerometer samples that is error, times sqrt(excess^2 - 1)."""
    stay: float = 0.0002
    """Random walk of a contact point that stays, m/sqrt(s)."""
    slide: float = 0.15
    """Standard deviation of the speed of a point that slides, m/s."""
    carry: float = 0.25
    """Weight of the latest sample in the learned velocity of a sliding foot, 0 to 1."""
    slip: float = 0.012
    """Standard deviation of a sliding foot's learned velocity, m/s, where each hypothesis has a state of its own."""
    slip_begin: float = 0.003
    """Probability per sample that a foot begins to slide, where each hypothesis has a state of its own."""
    slip_landing: float = 0.05
    """Probability that a foot slides when it comes down, where each hypothesis has a state of its own."""
    begin_slide: float = 0.6
    """Probability per sample that a point begins to slide, where each point is mixed alone at each sample."""
    go_on: float = 0.98
    """Probability per sample that a sliding point continues to slide."""
    learn: float = 0.03
    """Rate at which the log of the excess of the inertial noise follows the innovations, per sample of the feet."""
    rise: float = 1.5
    """Factor on a positive correlation of successive innovations (1 on a negative one) in the growth of the excess."""
    drop: float = 0.35
    """Correlation of successive innovations (times `rise` if positive) above which the excess grows, else it falls."""
    twist: float = 0.1
    """Random walk of a standing sole about the vertical, rad/sqrt(s): friction holds it by a small lever only."""
    roll: float = 0.05
    """Random walk of a standing sole about its long axis, rad/sqrt(s): weight that moves across bends leg and sole."""
    pitch: float = 0.002
    """Random walk of a standing sole about its short axis, rad/sqrt(s): its length resists."""
    rock: float = 0.5
    """Standard deviation of the turn rate of a sole that stands on an edge or a corner, rad/s."""
    creep: float = 0.008
    """Standard deviation of the velocity of the edge or corner on which a sole rocks, m/s."""
    most_excess: float = 15.0
    """Largest excess, the factor of the inertial noise over that of the sensor."""
    most_shaken: float = 0.1
    """Largest accelerometer noise times excess, m/s^2/sqrt(Hz), unless the stated noise exceeds it."""
    lag_s: float = 5.0
    """Time constant over which corrections of the position are averaged to the lag of the velocity, s."""


class BestLimits(NamedTuple):
    """Settings of the start of the filter and of its detection of rest, SI."""

    samples: int
    """Number of inertial samples that make a rest."""
    rest_s: float
    """Time that they take at 100 Hz or a higher rate, s."""
    gyro_variance: float
    """Largest variance of a gyro axis over a rest, (rad/s)^2; with more the robot moves."""
    acc_variance: float
    """Largest variance of an accelerometer axis over a rest, (m/s^2)^2; with more the robot moves."""
    travel: float
    """Largest distance of a foot's position from its mean within a rest, m, along each axis."""
    gyro_bias_sd: float
    """Standard deviation of an unknown gyro bias, rad/s."""
    acc_bias_sd: float
    """Standard deviation of an unknown accelerometer bias, m/s^2."""
    slope_sd: float
    """Standard deviation of the slope of the ground at the start, rad; infinite: unknown."""
    start: StartPose
    """Pose of base_link and height of the ground at the start."""
    start_sd: float
    """Standard deviation of position (m) and heading (rad) at the start."""
    gap_s: float
    """Step between inertial samples above which it is a gap and uncertainty is added, s."""
    forget_s: float
    """Step between inertial samples above which velocity and feet are forgotten, s."""
    max_speed: float
    """Estimated speed above which the velocity is an error and is forgotten, m/s."""
    level_sd: float
    """Standard deviation of a point's height over level ground, m per sample of the feet; infinite: not level."""
    hypotheses: bool
    """True if standing points may slide, by hypotheses about feet or at each sample; False: they never slide."""
    levels: bool
    """True if levels on which feet have stood correct the height, False if not."""
    creep: float = 0.0025
    """Standard deviation of a resting robot's turn rate about level axes, rad/s: servos settle under its weight."""
    turn_creep: float = 0.0005
    """Standard deviation of the turn rate of a robot at rest about the vertical, rad/s: its weight does not turn it."""


class BestSetting(NamedTuple):
    """Settings of the `best` filter: contact points and IMU mounting, noises and rates, limits of start and rest."""

    geometry: BestGeometry
    noise: BestNoise
    limits: BestLimits


class FixedNumbers(NamedTuple):
    """Numbers of the `best` filter that are equal for every robot, log and configuration."""

    rest_period_s: float = 0.01
    """Time, s, for which each of `standstill_samples` counts: a faster inertial unit needs more, for slow gaits are
    still for a tenth of a second."""
    most_samples: int = 1000
    """Largest number of inertial samples of a rest."""
    acc_share: float = 1.2
    """Factor of a walking robot's accelerometer noise over that of the data sheet."""
    point_share: float = 1.3
    """Factor of a point's noise where sliding is a hypothesis about feet, over that where each point may slide."""
    stated_sd: float = 1e-3
    """Standard deviation of a stated start pose, of position (m) and heading (rad)."""
    lost_sd: float = 1.0
    """Standard deviation of an unknown start pose, of position (m) and heading (rad)."""
    level_sd: float = 0.01
    """Standard deviation of a point over level ground, m per sample: edges, dust and lifting feet repeat themselves."""
    free: float = 1.0
    """Variance of the position of a point that touches nothing, m^2 per axis."""
    least_step: float = 0.025
    """Time after a sample of the feet within which another with the same contacts is skipped, s."""
    # corrections by a point
    vertical_slide: float = 0.25
    """Ratio of the vertical to a horizontal variance of sliding."""
    reported_begin: float = 0.01
    """Probability per sample that a foot begins to slide, in the model of the published probability of sliding."""
    reported_on: float = 0.9
    """Probability per sample that a sliding foot continues, in the model of the published probability of sliding."""
    slides: float = 0.5
    """Probability of sliding above which a foot is reported to slide."""
    outlier: float = 16.0
    """Normalised innovation squared above which a point counts less, the third in a row not at all; others left out."""
    learn_mistrust: float = 0.1
    """Weight of one sample in the running mean `mistrust` of a point, the fraction of outliers."""
    most_mistrust: float = 0.6
    """Mistrust, 0 to 1, above which a contact point's foot is left out or a switch or encoder counts as wrong."""
    forget_mistrust: float = 0.3
    """Rate at which the mistrust in a foot that is left out decays, 1/s."""
    most_misfits: int = 3
    """Number of outliers in a row after which a contact point is taken to be somewhere else."""
    surprise_s: float = 0.25
    """Time constant, s, of the mean of the points' normalised innovations squared."""
    most_surprise: float = 100.0
    """Limit at which the normalised innovation squared of a point is clipped in the mean over `surprise_s`."""
    # corrections by all feet
    most_carried: float = 3.0
    """Excess of the inertial noise at which the learning gain of a slide's velocity is halved; above, it falls fast."""
    swing: float = 0.2
    """Standard deviation of the velocity of a foot that may be in the air, m/s."""
    longest_gap: float = 0.3
    """Time without a sample of the feet after which any of them may have stepped and is placed anew, s."""
    most_lag: float = 5.0
    """Largest correction of the position that counts as lag, in standard deviations of a point; larger are clipped."""
    slide_memory: float = 0.99
    """Factor per sample by which the sums decay from which the persistence of slides is learned."""
    slide_trust: float = 1e-4
    """Weight of the prior assumption that slides persist, (m/s)^2, added to both sums of slide velocities."""
    least_persistence: float = 0.3
    """Correlation of slide velocities up to which no slide is expected to continue."""
    most_growth: float = 0.1
    """Limit of the change of the log of the excess by one pair of successive innovations, before `rise` and `drop`."""
    # sensors of the legs
    forget_fault: float = 0.15
    """Rate at which the mistrust in a sensor decays, 1/s: from 1 to `most_mistrust` in 3.4 s, longer than two steps."""
    jump: float = 0.015
    """Distance from a smooth path, m, above which an encoder has jumped. Clean: 12 mm at 55 Hz, 8 at 100, 4 at 200."""
    stand_step: float = 0.04
    """Longest step between samples at which a standing foot follows a smooth path, s; beyond, no jump is sought."""
    fly_step: float = 0.02
    """Longest step between samples at which a foot in the air follows a smooth path, s: at 33 ms it is 20 mm off."""
    crossed: float = 0.1
    """Fraction of their squared jumps by which two feet may miss each other's positions and still count as swapped."""
    turning: float = 0.1
    """Rate of the IMU, rad/s, above which it certainly turns, so that frozen encoders show."""
    usual_s: float = 1.0
    """Time constant of the gyro's mean, s; deviations of the gyro from it are turning, whatever the bias."""
    most_repeated: float = 0.03
    """Turn of the IMU, rad, while a foot on the ground repeats its sample, above which it is frozen. Clean: 0.009."""
    longest_repeat: float = 0.1
    """Limit at which the step between two samples of the feet, s, is clipped in `held` and `repeated`."""
    longest_held: float = 0.25
    """Time for which slow encoders may repeat the samples of all feet together without being frozen, s."""
    strange_s: float = 0.25
    """Time constant, s, with which a foot's motion beyond the inertial unit decays, before bias adds up."""
    longest_compared: float = 0.05
    """Longest step between two samples of the feet over which they are compared, s: in a longer one feet land."""
    most_strange: float = 2.0
    """Change of a foot's velocity between two samples, m/s, from which on it is a jump of encoders and not a motion."""
    unsure_speed: float = 0.05
    """Speed of a foot that encoders do not distinguish from rest, m/s: 1 mm in two samples 25 ms apart."""
    level_share: float = 0.15
    """Weight of level motion, 1 for vertical, in the comparison with switches: standing feet slide, but do not rise."""
    most_level: float = 0.2
    """Limit of the weighted level motion in that comparison, m/s: a fast swing would still count after landing."""
    against_s: float = 0.2
    """Time constant, s, of the comparison of switches with motion; one that hangs has not changed for as long."""
    most_more: float = 0.8
    """Limit at which the log ratio of one sample is clipped in the mean over `against_s`: a landing foot may bounce."""
    most_against: float = 0.3
    """Mean log ratio of motions above which a switch is wrong; twice that for a single one that has just changed."""
    most_right: float = 0.5
    """Limit of the mean log ratio by which motion agrees with a switch of a biped, so that a new fault shows soon."""
    risen: float = 0.008
    """Rise of one of two feet over the other, m, above which it does not stand. Clean logs, both closed: 7 mm."""
    lifted: float = 0.003
    """Rise of a foot with an open switch, m, from which on it has been in the air since the switch opened."""
    rises_s: float = 0.02
    """Time for which a rise has to contradict the switches before one is wrong, s; two samples at least."""
    delay_forget_s: float = 0.25
    """Time constant, s, with which motion beyond the inertial unit decays in the search for late stamps of the feet."""
    delay_s: float = 1.0
    """Time constant, s, of the sums in the search for late stamps of the feet."""
    delay_least_s: float = 0.5
    """Least time on the ground, of all feet together, before late stamps are reported, s."""
    delay_period: float = 0.012
    """Step between inertial samples, s, below which late stamps of the feet are sought: 55 Hz would show wrong ones."""
    delay_vertical: float = 0.15
    """Weight of vertical motion, 1 for level motion, in the search for late stamps: feet land along the vertical."""
    delay_share: float = 0.3
    """Fraction of the feet's motion beyond the inertial unit explained by late stamps, above which they are late."""
    delay_lasts_s: float = 0.15
    """Time for which feet must show late stamps before these are corrected, s: one event is no sign."""
    delay_speed: float = 0.012
    """Rms speed explained by late stamps, m/s, from which on feet are late: robots that sway show 0.006 at most."""
    least_delay_s: float = 0.015
    """Delay of the feet's stamps, s, above which it is corrected: walks of clean logs show 0.010 at most."""
    most_delay_s: float = 0.07
    """Delay of the feet's stamps, s, above which it is ignored: rolling feet show 0.08, early."""
    most_late_s: float = 0.15
    """Limit, s, of the total correction of stamps by the feet's motion: a delay that grows on is another fault."""
    legs_s: float = 2.0
    """Time constant, s, over standing time with which the noise of contact points is averaged."""
    least_legs_s: float = 0.5
    """Least standing time, of all feet together, before the noise of contact points is lowered, s."""
    least_way: float = 1e-6
    """Motion of a foot between two samples that no encoder resolves, m; floor in the logarithm of its noise."""
    least_point: float = 2.5e-4
    """Least stated noise of a contact point, standard deviation, m: legs and soles of no robot are below."""
    sure_point: float = 3e-4
    """Standard deviation of a contact point below which standing feet never lower it, m."""
    more_point: float = 1.2
    """Factor over the noise that standing feet show from sample to sample, to which a point's noise is lowered."""
    weight_s: float = 0.05
    """Time constant, s, of the mean norm of the accelerometer: in flight it falls to zero as soon."""
    longest_aloft: float = 0.2
    """Time without a closed switch, s, above which no switch of a robot that shows its weight is believed."""
    # heading
    parting: float = 0.02
    """Rate of standing feet parting, 1/s, at which the heading follows gyro and feet equally; above, more the gyro."""
    parting_s: float = 1.5
    """Standing time over which the squared rate of parting is averaged, s."""
    least_stood: float = 0.1
    """Shortest time, s, for which the same feet must stand to show the rate of parting."""
    own_sd: float = 0.002
    """Standard deviation of a gyro bias that was not observed at rest, for heading by the gyro, rad/s."""
    own_unknown: float = 0.01
    """Gyro bias times the share of the feet in the heading, rad/s, above which the assumption of no bias, made before
    the first rest, is dropped."""
    firm: int = 3
    """Number of closed switches that hold a sole flat on the ground; with fewer it may rock."""
    # levels of the ground
    settles: float = 0.06
    """Time after which a foot that has come down rests firmly on the ground, s."""
    same_level: float = 0.03
    """Height difference, m, up to which a foot may stand on a known level of the ground."""
    step_sd: float = 0.003
    """Standard deviation of the height at which one step lands on a level of flat ground, m."""
    least_uneven: float = 0.001
    """Least unevenness (rms height difference) of a level ground, m."""
    most_slope: float = 0.02
    """Slope of the ground, rad, from which on it has no levels: 1.1 deg."""
    slope_sd: float = 0.01
    """Prior standard deviation of the ground's slope before feet have shown it, rad."""
    learn_ground: float = 0.125
    """Weight of one step in the running means of unevenness and slope of the ground, 0 to 1."""
    sink_s: float = 2.0
    """Time constant, s, of the sums of landing heights that show sinking feet; longest time between two landings."""
    sink_least_s: float = 0.25
    """Time, s, added to that between landings in the speed of sinking; landings must show it for twice as long."""
    least_sink: float = 0.012
    """Speed of sinking, m/s, below which landings only scatter; half of it once feet sink."""
    hidden_slope: float = 0.005
    """Slope of the ground, standard deviation, rad, that feet which stand at the same time fail to show."""
    sink_scatter: float = 8.0
    """Ratio of the sum of landing heights to the unevenness of the ground above which feet sink."""
    sink_slopes: float = 1.2
    """Ratio of the speed of sinking to the climb of the ground's slope at this speed, above which feet sink."""
    sink_walk: float = 1.5
    """Random walk of the common height of standing points, m/sqrt(s), for each m/s of the speed of sinking."""
    level_gate: float = 4.0
    """Squared normalised height difference (1 degree of freedom, 95 %) up to which a step is on a ground level."""
    # hypotheses about sliding feet
    most_feet: int = 2
    """Largest number of feet for which each set of sliding feet is a hypothesis; with more, points are mixed alone."""
    least_prior: float = 0.01
    """Probability before a sample of the feet below which a hypothesis is dropped, unless it is the most probable."""
    least_weight: float = 0.01
    """Probability after a sample of the feet below which a hypothesis is dropped."""
    no_share: float = 0.01
    """Share, of a hypothesis in a mean or of the gyro in the heading, below which it counts as 0."""
    # gaps and losses, beside the constants of `params`
    lost_share: float = 0.2
    """Variance of the mean of lost inertial samples as a fraction of the squared changes of the samples around them."""
    lost_memory: float = 1.0
    """Time after a loss of the velocity within which a second loss makes the tilt suspect, s."""
    # start
    good_tilt: float = 0.03
    """Standard deviation of the tilt, rad, below which a start in motion may have settled."""
    good_speed: float = 0.05
    """Standard deviation of the velocity, m/s, below which a start in motion may have settled."""
    good_age: float = 0.7
    """Time after a start in motion before which it has not settled, s."""
    fresh_age: float = 2.0
    """Time after a start in motion within which a rest replaces it as a better start, s."""
    moving_tilt: float = 0.52
    """Standard deviation of the tilt with which a robot in motion starts, rad: 30 deg."""
    moving_excess: float = 6.0
    """Excess of the inertial noise with which a robot in motion starts, until that of its walk is known."""
    contradiction: float = 4.0
    """Difference, in standard deviations, above which the rest's accelerometer contradicts stated slope or tilt."""
    plane_point: float = 5e-4
    """Standard deviation of a foot of an assembled robot from its position in the model, m."""
    tilted: float = 0.7
    """Mean level acceleration, m/s^2, from which on it shows a wrong tilt (4 deg), at rest or after a lost velocity."""
    most_noise: float = 1.6
    """Factor over a rest's noisiest axis to which a sensor's stated noise is lowered. Clean logs: 1.56."""
    more_noise: float = 1.3
    """Ratio of a rest's middle axis to the stated noise above which the stated noise is raised. Own walks: 1.15."""
    least_noise: float = 0.03
    """Fraction of the stated noise below which a rest shows the sensor's resolution, and the noise stays as stated."""
    waking: float = 24.0
    """Added to the squared excess of the inertial noise as a rest ends, falling to 0 in `waking_s` (a parabola)."""
    waking_s: float = 0.6
    """Time for which the noise of the walk after a rest is not known, s: with 1 s, fewer slides are recognised."""
    woken_excess: float = 2.2
    """Excess of the inertial noise just after a rest, from which on the tilt of the rest is checked. Clean logs: 2."""
    woken_s: float = 1.0
    """Time after a rest until which the tilt of the rest is checked, s."""
    woken_least_s: float = 0.2
    """Time after a rest before which its tilt is not corrected, s."""
    woken_speed: float = 0.15
    """Level velocity that the feet have corrected since a rest, m/s, above which the rest's tilt is wrong."""
    woken_straight: float = 0.9
    """Fraction of the squared velocity corrected by the feet that grows steadily, above which the tilt is wrong."""
    suspected: float = 0.05
    """Mistrust in a leg's sensor, 0 to 1, up to which it is ignored: reached 20 s after a fault."""
    tilted_for: float = 0.1
    """Least time over which the mean level acceleration is compared with `tilted`, s."""
    tilted_sd: float = 0.3
    """Standard deviation of a tilt corrected by the mean accelerometer of a robot in motion, rad."""
    upright: float = 0.76
    """Cosine of the tilt (40 deg) below which a robot has fallen, so that lost feet do not mean a wrong tilt."""
    falling: float = 0.1
    """Fraction of gravity by which a standing robot's specific force may differ; beyond, no tilt is corrected."""
    # published pose
    pose_walk: float = 0.001
    """Random walk of the published position while the excess of the inertial noise is sqrt(2), m/sqrt(s)."""
    # poses, headings and velocities from elsewhere
    frame_sd: float = 100.0
    """Standard deviation of the shift of an external source's unknown frame, m; the first pose then places it."""
    frame_turn_sd: float = 3.0
    """Standard deviation of the turn of an external source's unknown frame, rad; the first pose then places it."""
    most_jumps: float = 10.0
    """Number of external poses in a row that do not fit, from which on their frame has jumped: 1 s of a camera."""
    length_sd: float = 0.01
    """Standard deviation of the magnitude of gravity, m/s^2, which the state takes as known."""


FIXED = FixedNumbers()
