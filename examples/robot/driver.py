"""A robot of your own in place of the simulator: `surefoot up examples/robot/system.yaml`; see docs/extending.md."""

import numpy as np

from surefoot.errors import Refusal
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.launch import main
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import EmergencyStop, FootContacts, Imu, JointCommand, JointState
from surefoot.schemas.status import SimStatus
from surefoot.schemas.topics import CMD_ESTOP, HW_CONTACTS, HW_IMU, HW_JOINTS, SIM_JOIN, SIM_STATUS, TICK_NS

# It has no hardware: its joints follow as servos do, its trunk stays level. Put yours where HARDWARE stands.
STEP_RAD, TOUCH_M = 0.05, 0.003  # the most a joint moves in a tick; height over the lowest foot that counts as touch


class MyRobot(Driver[ServiceConfig]):
    name = "my-robot"
    outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS, SIM_STATUS)  # what it has; no service waits for what is not here
    observes, serves = (CMD_ESTOP,), (SIM_JOIN,)

    def on_start(self) -> None:
        self.robot = load_robot(self.config.robot)  # SUREFOOT_ROBOT: a name, or your folder with a robot.toml
        self.joints, self.stopped = self.robot.neutral.copy(), ""  # HARDWARE: open the bus, read the encoders
        foot_positions(self.robot.model, self.joints)  # compiled now, not in the first tick

    def on_begin(self) -> None:  # these two must be there before tick 0; others join when they come
        self.node.begin(("estimator", "walker"), "paced", rtf=1.0, delay=1, policy="degrade", seed=0)

    def release(self, tick: int) -> list[DueSample]:
        now, up = tick * TICK_NS, (0.0, 0.0, 9.81)  # HARDWARE: inertial unit, its frame; stamp = END of its window
        samples = [DueSample(HW_IMU, Imu(acc=up, gyro=(0.0, 0.0, 0.0)), now, tick)]
        if tick % 3 == 0:  # HARDWARE: encoders and switches, as often as they come
            z = foot_positions(self.robot.model, self.joints)[:, 2]
            touch = tuple((bool(low),) for low in z < z.min() + TOUCH_M)
            joints = JointState(position=tuple(self.joints))
            feet = FootContacts(touch=touch, normal_force_n=(None,) * len(touch))
            samples += [DueSample(HW_JOINTS, joints, now, tick // 3), DueSample(HW_CONTACTS, feet, now, tick // 3)]
        return samples

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        if command is not None and command.position is not None and not self.stopped:  # else: hold what was
            self.joints += np.clip(np.array(command.position) - self.joints, -STEP_RAD, STEP_RAD)  # HARDWARE: servos

    def check(self, command: JointCommand) -> None:
        q, robot = command.position, self.robot
        if q is not None and not (len(q) == robot.nj and np.all((robot.joint_lower <= q) & (q <= robot.joint_upper))):
            raise Refusal("out_of_range", f"expected {robot.nj} angles within the limits, got {q}", "position")

    def on_message(self, topic: object, message: object) -> None:
        if isinstance(message, EmergencyStop):  # hold; then publish it, for `surefoot stop` waits for it
            self.stopped, run = message.reason or "no reason given", self.node.leader
            now = {"state": run.state, "ticks": run.tick + 1, "tick": run.tick, "epoch": run.epoch, "rtf": 1.0}
            self.publish(SIM_STATUS, SimStatus.model_validate({**now, "comparable": False, "stopped": self.stopped}))


if __name__ == "__main__":
    main(MyRobot)
