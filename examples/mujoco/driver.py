"""A MuJoCo model of your own, moved by a Python function of your own, in place of the robot; see docs/own-driver.md."""

import json
import runpy
from pathlib import Path

import mujoco as mj
import numpy as np

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.lockstep.intake import Intake
from surefoot.lockstep.launch import main
from surefoot.robot.reader import load_robot
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, SIM_JOIN, TICK_S


class MujocoConfig(ServiceConfig):
    model: str = "scene.xml"  # MJCF with a floor; the robot was imported from it, under the same names
    controller: str = "controller.py"  # file with control(model, data), which sets data.ctrl before each step


class MujocoRobot(Driver[MujocoConfig]):
    name, Config = "mujoco-robot", MujocoConfig
    outputs, serves = (HW_IMU, HW_JOINTS, HW_CONTACTS), (SIM_JOIN,)

    def on_start(self) -> None:
        robot, known = load_robot(self.config.robot), json.loads(Path(self.config.robot, "import.json").read_text())
        self.model = m = mj.MjModel.from_xml_path(self.config.model)
        self.data, self.intake = mj.MjData(m), Intake(robot)
        mj.mj_resetDataKeyframe(m, self.data, 0 if m.nkey else -1)
        self.control = runpy.run_path(self.config.controller)["control"]
        self.at = [m.joint(known["joints"][name]).qposadr[0] for name in robot.joint_names]
        self.feet = [m.body(known["feet"][leg]["body"]).id for leg in robot.leg_names]
        site, kinds = mj.mj_name2id(m, mj.mjtObj.mjOBJ_SITE, "imu"), mj.mjtObj
        self.imu = (kinds.mjOBJ_SITE, site) if site >= 0 else (kinds.mjOBJ_XBODY, m.body(known["trunk"]).id)

    def on_begin(self) -> None:  # "lockstep" and 0.0: as fast as the services follow
        self.node.begin(("estimator",), "paced", 1.0, 1, "degrade", 0)

    def release(self, tick: int) -> list[DueSample]:
        m, d, felt = self.model, self.data, np.zeros((2, 6))
        while d.time < (tick + 1) * TICK_S:
            self.control(m, d)
            mj.mj_step(m, d)
            mj.mj_rnePostConstraint(m, d)  # accelerations with gravity, as an inertial unit feels them
            mj.mj_objectVelocity(m, d, *self.imu, felt[0], 1)
            mj.mj_objectAcceleration(m, d, *self.imu, felt[1], 1)
            down = {int(m.geom_bodyid[geom]) for pair in d.contact.geom for geom in pair}
            down |= {int(m.body_parentid[body]) for body in down}  # a foot may be a body of its own
            self.intake.imu(now := round(1e9 * d.time), felt[0, :3], felt[1, 3:])
            self.intake.feet(now, [foot in down for foot in self.feet])
            self.intake.joints(now, d.qpos[self.at])
        return self.intake.release(tick)

    def actuate(self, tick: int, command: object) -> None: ...  # the function of your own moves the robot


if __name__ == "__main__":
    main(MujocoRobot)
