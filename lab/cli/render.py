"""Command `surefoot render`: a recording as a moving picture."""

from pathlib import Path
from typing import Annotated

import typer

from .output import Json, near, refuse_existing, refuse_unreachable, use_json, write, write_json
from .progress import Progress


def render(
    file: Annotated[Path, typer.Argument(help="MCAP file of a run.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Picture: .webp, .gif, .mp4 (needs ffmpeg), .png.")],
    start: Annotated[float, typer.Option(min=0.0, help="Begin so many s after the beginning; time of a .png.")] = 0.0,
    end: Annotated[float | None, typer.Option(min=0.0, help="End so many s after the beginning.")] = None,
    speed: Annotated[float, typer.Option(min=0.01, help="Simulated over shown time.")] = 1.0,
    fps: Annotated[float, typer.Option(min=1.0, max=60.0, help="Pictures a second.")] = 15.0,
    width: Annotated[int, typer.Option(min=160, max=3840, help="Width in pixels; the height is 9/16 of it.")] = 960,
    quality: Annotated[int, typer.Option(min=1, max=100, help="Of WebP.")] = 60,
    still: Annotated[bool, typer.Option("--still", help="The camera shows the whole way and does not follow.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    json: Json = False,
) -> None:
    """Paint a recording as a moving picture: robot, ground, support region, centre of mass, forces."""
    from ..scene.endings import kind_of

    use_json(json)
    kind_of(out)
    refuse_existing(out, force=force)
    refuse_unreachable(out, makes_folders=False)
    with Progress(out.name, reads=[file]) as progress:
        from ..scene.render import Shot
        from ..scene.render import render as paint

        shot = Shot((width, 2 * round(width * 9 / 32)), fps, speed, start, end, still, quality)
        painted = paint(file, out, shot, progress.at)
    size = out.stat().st_size
    if json:
        write_json({"file": near(out), "frames": painted.frames, "bytes": size, "notes": painted.notes})
    else:
        write(f"{near(out)}: {painted.frames} frame{'s' * (painted.frames != 1)}, {size / 1e6:.2f} MB")
        for note in painted.notes:
            write(f"note  {note}")
