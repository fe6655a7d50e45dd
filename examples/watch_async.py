"""Watch velocity and gait side by side on `asyncio`. Start a system first: `surefoot up ragno`."""

import asyncio
import sys

import surefoot


async def watch(robot: surefoot.AsyncClient, key: str, count: int) -> None:
    """Print the first messages of a topic."""
    shown = 0
    async for message in robot.messages(key):
        print(f"{key} at {message.stamp_ns * 1e-9:.2f} s")
        shown += 1
        if shown == count:
            return


async def main() -> None:
    """Join the system, and watch two topics at a time."""
    async with await surefoot.connect_async("ragno", sys.argv[1] if len(sys.argv) > 1 else None) as robot:
        await asyncio.gather(watch(robot, "state/velocity", 5), watch(robot, "state/gait", 3))


if __name__ == "__main__":
    try:
        asyncio.run(main())
    except surefoot.SurefootError as error:
        sys.exit(str(error))
