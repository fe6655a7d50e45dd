"""Configuration of the navigator service."""

from typing import Literal

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig


class NavigatorConfig(ServiceConfig):
    """Settings of the navigator service: start pose, maps, policy."""

    params: str = Field(default="nao", max_length=256, description="model of the robot: a shipped name or a .toml file")
    set: tuple[str, ...] = Field(
        default=(), max_length=64, description="changes of the model, key=value as in conduct.stuck=60"
    )
    policy: str = Field(default="planner", max_length=256, description="name or file of the default policy")
    actions: str = Field(default="", max_length=64, description="action set of the model; empty = the model's own")
    control: Literal["commands", "odometry"] = Field(
        default="odometry", description="input of the belief between observations; without odometry: commands"
    )
    use_landmarks: bool = Field(default=True, description="correct the pose with hw/landmarks")
    start_x: float = Field(default=0.0, description="m, start pose in map")
    start_y: float = Field(default=0.0, description="m, start pose in map")
    start_yaw: float = Field(default=0.0, description="rad, start heading in map")
    map: str | None = Field(default=None, description="map_server YAML file; null = from terrain/map")
    landmarks: str | None = Field(default=None, description="landmark map file; null = from terrain/landmarks")
    zones: str | None = Field(
        default=None, description="YAML with keepout zones and speed limits; null = those in the YAML of map"
    )
    robot_radius: float = Field(default=0.15, ge=0, le=2, description="m, kept free of obstacles")
    through_unknown: bool = Field(default=True, description="routes may lead over cells that the map does not know")
    viewing_distance: float = Field(default=6.0, gt=0, le=100, description="m, longest way between two waypoints")
    memory: str | None = Field(
        default=None, description="file of this run that keeps the goal for a navigator that is started again"
    )
