"""Build the wheel with its compiled kernels: `python scripts/build_wheel.py [FOLDER]`.

The wheel is for the Python that runs this program, and for x86-64 processors with AVX2 and FMA; elsewhere, and with
another version of numba, kernels are compiled on first use as from a plain wheel. Kernels that the checkout has
compiled are taken over; missing ones are compiled by the wheel's own code, as by `surefoot warm --all`, and by a first
call of each function of the library. With `--systems` these are the kernels of some systems, of a run in one process
and of an estimate only.
"""

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from setuptools.build_meta import build_wheel
from wheel.wheelfile import WheelFile

from surefoot.errors import SurefootError
from surefoot.kernels.processor import LEVEL, processor

ROOT = Path(__file__).resolve().parents[1]
BROUGHT = "surefoot/kernels/brought.txt"
FIRST_CALLS = """
import runpy, sys
import surefoot
surefoot.simulation.run("stand", seed=3, recording="stand.mcap")
for path in sys.argv[1:]:
    runpy.run_path(path, run_name="__main__")
"""
TAG = f"{sys.implementation.cache_tag.replace('cpython-', 'cp')}-none-manylinux_2_28_x86_64"


def main(words: Sequence[str] | None = None) -> None:
    """Build the wheel and print its path."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default="dist", type=Path, help="where it is written (default: dist)")
    parser.add_argument("--systems", nargs="*", help="kernels of these systems only (default: all)")
    parser.add_argument("--kernels", default=ROOT, type=Path, help="checkout whose kernels are taken over (this one)")
    parser.add_argument("--no-compile", action="store_true", help="with the kernels that are taken over only")
    options = parser.parse_args(words)
    systems = () if options.no_compile else options.systems
    sys.stdout.write(f"{compiled_wheel(options.folder.resolve(), systems, options.kernels.resolve())}\n")


def compiled_wheel(folder: Path, systems: Sequence[str] | None = None, kernels: Path = ROOT) -> Path:
    """Build a wheel with the kernels of these systems and of the library; return its path.

    Args:
        folder: where it is written.
        systems: names of compose files; None = all, none of them: no kernel is compiled.
        kernels: checkout whose compiled kernels are taken over where the sources are equal.

    Raises:
        SurefootError: this processor is not of the level that the wheel is for.
    """
    if processor() != LEVEL:
        raise SurefootError("wheel", f"kernels of a wheel are compiled for {LEVEL}, which this processor is not")
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(ROOT)
    with TemporaryDirectory() as work:
        plain = Path(work) / build_wheel(work)
        site = _install(plain, Path(work) / "environment")
        _take_over(kernels, site / "surefoot")
        _compile(site, systems)
        whole = Path(work) / "whole"
        with zipfile.ZipFile(plain) as wheel:
            wheel.extractall(whole)
        for path in (*site.rglob("*.nb[ic]"), site / BROUGHT):
            _copy(path, whole / path.relative_to(site))
        (info,) = whole.glob("*.dist-info")
        text = (info / "WHEEL").read_text().replace("Tag: py3-none-any", f"Tag: {TAG}")
        (info / "WHEEL").write_text(text.replace("Root-Is-Purelib: true", "Root-Is-Purelib: false"))
        (info / "RECORD").unlink()
        target = folder / plain.name.replace("py3-none-any", TAG)
        target.unlink(missing_ok=True)
        with WheelFile(target, "w") as wheel:
            wheel.write_files(str(whole))
    return target


def _install(wheel: Path, environment: Path) -> Path:
    """Install a wheel into an environment of its own, with the packages of this one; return its folder of packages."""
    venv.create(environment, with_pip=False, symlinks=True)
    (site,) = environment.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as content:
        content.extractall(site)
    for data in site.glob("*.data/data/*"):
        data.rename(environment / data.name)
    (site / "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    return site


def _take_over(checkout: Path, package: Path) -> None:
    """Copy the kernels of a checkout; numba takes those whose sources are the wheel's."""
    for path in (checkout / "surefoot").rglob("*.nb[ic]"):  # does not follow links
        _copy(path, package / path.relative_to(checkout / "surefoot"))
    for name in ("services", "schemas", "lab"):
        for path in (checkout / name).rglob("*.nb[ic]"):
            _copy(path, package / path.relative_to(checkout))


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(source, target)


def _compile(site: Path, systems: Sequence[str] | None) -> None:
    """Compile what is missing, and note in the package which services find all their kernels."""
    if systems is not None and not systems:
        (site / BROUGHT).touch()
        return
    environment = site.parents[2]
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "PYTHON"))}
    kept["XDG_CACHE_HOME"] = str(environment / "cache")

    def run(*words: str) -> None:
        command = [str(environment / "bin" / "python"), *words]
        subprocess.run(command, check=True, env=kept, cwd=environment, stdout=sys.stderr)

    run("-m", "surefoot.lab.cli.main", "warm", *(["--all"] if systems is None else systems))
    examples = () if systems else sorted((ROOT / "examples" / "library").glob("*.py"))
    run("-c", FIRST_CALLS, *map(str, examples))
    run("-m", "surefoot.lab.cli.main", "estimate", "stand.mcap", "--calibrate")
    stamps = sorted({path.name for path in (environment / "cache" / "surefoot" / "warm").glob("*/*")})
    (site / BROUGHT).write_text("\n".join(stamps) + "\n")


if __name__ == "__main__":
    main()
