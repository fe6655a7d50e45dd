"""Texts for users on the state of simulated time."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.schemas.status import SimStatus


def standing_still(status: "SimStatus") -> str:
    """Return a text on why simulated time stands still; empty while it runs."""
    at = f"at tick {status.tick}" if status.tick >= 0 else "before tick 0"
    match status.state:
        case "running":
            return ""
        case "paused":
            return f"simulated time is paused {at}; `surefoot sim resume` lets it go on"
        case "joining" | "holding":
            missing = ", ".join(status.missing) or "nothing"
            return f"simulated time stands still {at}: it waits for {missing}"
        case _:
            why = status.failed or status.detail
            return f"the run has ended {at}{f' ({why})' if why else ''}; `surefoot sim reset` begins a new one"


def pace(status: "SimStatus") -> str:
    """Return a text on simulated time: its real-time factor, lateness and held joints, or why it stands still."""
    still = standing_still(status)
    rate = f"at {status.rtf:.2f} times real time, " if status.rtf > 0.0 else ""  # 0: nothing was measured yet
    words = [still] if still else [f"simulated time runs {rate}tick {status.tick}".replace("runs tick", "runs: tick")]
    if status.late and not still:
        words.append(f"late: {status.pace:g} is asked for")
    if status.held:
        words.append(f"the joints are held ({status.held})")
    return "; ".join(words)
