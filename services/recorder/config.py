"""Configuration of the recorder."""

from pydantic import Field, TypeAdapter, ValidationError

from surefoot.lockstep.config import ServiceConfig


class RecorderConfig(ServiceConfig):
    """Settings of the recorder: file, images, buffer of the last seconds, facts on the run."""

    path: str | None = Field(default="run.mcap", description="MCAP file; null or empty = only the hash is computed")
    ring_s: float = Field(
        default=0.0,
        ge=0,
        le=600,
        description="s of simulated time: keep the last so many in memory, about 1 MB each, and write them on a fall, "
        "a stop or `recorder/save`, a file each beside path, `run-fall.mcap`; 0 = the whole run into path",
    )
    images: bool = Field(
        default=False, description="record hw/image and hw/depth, too; they then count in the hash of the run"
    )
    about: str = Field(default="", description="JSON object of tables of texts that become metadata of the file")

    @property
    def tables(self) -> dict[str, dict[str, str]]:
        """Return the tables of the text `about` by name; of an invalid text one table with its first 200 characters."""
        try:
            found = TypeAdapter(dict[str, dict[str, str]]).validate_json(self.about) if self.about else {}
        except ValidationError:
            found = {"about": {"unreadable": self.about[:200]}}
        return found
