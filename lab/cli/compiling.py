"""Progress lines for a command that compiles numeric kernels for longer than a moment: share done, time left."""

import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager

from surefoot.kernels.compiling import COMPILING

from .progress import EACH_S, FIRST_S, LEAST_SHARE, SECOND_S

COSTS: Mapping[str, tuple[Mapping[str, float], ...]] = {
    "estimate": (
        {
            "matrix_from_quat": 0.5, "_feet_in_imu": 2.7, "integrate": 1.7, "_ahead": 1.0, "_rolling": 2.0,
            "_misfit": 2.7, "foot_positions": 0.6, "clear": 2.7, "boxed": 1.6, "follow_log": 102.5,
        },
        {"integrate": 1.9, "_ahead": 1.0, "_rolling": 0.6, "_misfit": 2.2, "follow_log": 27.5},
    ),
    "audit": (
        {
            "foot_positions": 1.3, "com": 0.9, "_normalise": 0.4, "plane": 0.5, "has_axes": 0.2, "carried": 0.9,
            "hull": 1.4, "area": 0.2, "matrices": 0.9, "outline": 22.1,
        },
    ),
    "bag import": (
        {
            "matrix_from_quat": 0.4, "foot_positions": 1.9, "clear": 2.8, "boxed": 2.1, "take_imu": 5.6, "_push": 0.6,
            "_feet_in_imu": 1.5, "take_feet": 9.4, "known_feet": 0.2, "_at": 0.6, "leg_velocity": 5.3, "predict": 2.0,
            "correct": 1.7, "report": 100.8, "_refined": 0.3, "_turned": 1.0, "_faulty": 0.7, "_followed": 1.7,
            "summary": 0.4, "condition_now": 1.5, "restart": 2.7, "plane": 0.7, "matrices": 0.7, "outline": 22.9,
            "explore": 3.0, "solve_lanes": 2.7, "carried": 0.5, "ray": 0.5, "wide": 0.4, "line_of": 0.6,
            "flat_ends": 0.9, "enclose": 3.5, "_normalise": 0.5, "feet_in_world": 0.6, "_moved": 3.8,
            "com_in_world": 0.6, "_leg_inverses": 2.4, "_leg_forces": 0.6, "_com": 1.7, "_footing": 2.4,
        },
    ),
    "report": ({"matrix_from_quat": 0.4, "foot_positions": 1.7, "forward": 0.4, "inverse3": 0.6},),
    "footholds collect": (
        {
            "foot_positions": 1.6, "quat_from_rpy": 0.2, "multiply": 0.3, "heights": 0.9, "_forces": 0.7,
            "_feet": 1.6, "_joints": 0.2, "_imu": 0.8, "median3": 1.5, "even_edges": 0.6, "_planes": 1.1,
            "dilate": 0.6, "matrix_from_quat": 0.3, "clear": 2.5, "boxed": 1.8, "take_imu": 5.1, "_feet_in_imu": 1.6,
            "take_feet": 8.5, "known_feet": 0.1, "report": 91.7, "condition_now": 1.3, "wrap_angle": 0.3,
            "matrix_from_rpy": 0.1, "into_map": 0.2, "set_points": 9.8, "_push": 0.4, "_note": 0.1, "_put": 0.1,
            "_at": 0.4, "_travel": 0.2, "leg_velocity": 4.4, "into_base": 0.1, "bilinear": 0.1, "box_max": 0.4,
            "predict": 2.4, "peak": 0.1, "correct": 1.3, "patch": 0.5, "coefficients": 1.8, "_predict": 0.4,
            "_add": 0.3, "_distances": 0.2, "_mask": 3.6, "count_reasons": 0.3, "_q": 0.5, "gradient": 0.1,
            "_swept": 0.8, "legs_ik": 1.3, "clears": 0.5, "face_normal": 0.7, "quat_from_matrix": 0.1, "com": 0.6,
            "targets": 0.6, "smooth": 1.5,
        },
    ),
    "footholds gather": (
        {"median3": 1.4, "even_edges": 0.4, "_planes": 0.9, "dilate": 0.5, "patch": 0.3, "coefficients": 1.1},
    ),
    "robot import": (
        {
            "forward": 1.1, "foot_positions": 0.5, "_feet_and_jacobians": 1.3, "matrix_from_quat": 0.2, "com": 0.7,
            "gravity_torques": 1.3, "foot_jacobians": 0.8,
        },
    ),
    "robot check": ({"foot_positions": 1.3, "com": 0.9},),
    "robot show": ({"forward": 1.2, "foot_positions": 0.5, "com": 0.9, "matrix_from_quat": 0.3},),
    "evaluate": ({"_sweep": 1.3, "inverse3": 0.6, "squares": 0.1, "_run": 14.2},),
    "fit": (
        {
            "wrap": 0.1, "fade": 0.4, "match": 6.4, "fill_gain": 0.2, "update": 1.6, "entropy": 0.2, "predict": 1.2,
            "minus_log_likelihoods": 3.8,
        },
    ),
    "train": ({"_sweep": 1.6, "inverse3": 0.6}, {"squares": 0.1, "learn": 14.5, "_run": 2.4}),
}  # fmt: skip
"""Processor time to compile each kernel on a slow core, s, by command (of a group: both words); kernels in order of
compilation. `estimate` has an order for an empty cache and one for a cache with the services' kernels; `train` one for
planner, one for sarsa."""
PACED_S = 4.0
"""Usual processor time of the finished kernels, s, from which on their measured time scales estimates of the rest."""
MOST = 0.95
"""Largest share of a kernel's usual compilation time that counts as done before the kernel is compiled."""


def costs_of(words: Sequence[str]) -> tuple[Mapping[str, float], ...]:
    """Return the kernels of the command of a command line, by order of compilation; empty if they are not known."""
    return COSTS.get(" ".join(words[:2])) or COSTS.get(next(iter(words), ""), ())


class CompiledShare:
    """Share of the compilations of a command that is done, by the usual processor time of each kernel.

    Args:
        chains: kernels in the order in which they are compiled, with their usual processor time, s; the chain that
            begins with the first compiled kernel is used, else the last one.
        clock: returns the processor time of this process, s.
    """

    def __init__(self, chains: Sequence[Mapping[str, float]], clock: Callable[[], float] = time.process_time) -> None:
        self._chains, self._clock = chains, clock
        self._left: dict[str, float] = {}  # of the chain, from the first kernel that is compiled on
        self._name, self._began, self._since = "", 0.0, 0.0

    def began(self, name: str) -> None:
        """Record that the compilation of a kernel begins; kernels before it in the chain are done or were cached."""
        self._name, self._since = name, self._clock()
        if not self._left and self._chains:
            chain = next((each for each in self._chains if next(iter(each)) == name), self._chains[-1])
            names = list(chain)
            self._left = {each: chain[each] for each in names[names.index(name) :]} if name in chain else {}
            self._began = self._since

    def now(self) -> float:
        """Return the finished share of the compilations, 0 to 1; 0 while a kernel without a known cost is compiled."""
        if self._name not in self._left:
            return 0.0
        before, here = self._spent()
        return (before + min(here, MOST * self._left[self._name])) / sum(self._left.values())

    @property
    def late(self) -> bool:
        """True if the present kernel takes longer than usual, so that the share stands still; else False."""
        return self._name in self._left and self._spent()[1] > self._left[self._name]

    def _spent(self) -> tuple[float, float]:
        """Return the usual processor time, s, of the finished kernels, and that spent on the present one."""
        names = list(self._left)
        before = sum(self._left[each] for each in names[: names.index(self._name)])
        pace = (self._since - self._began) / before if before >= PACED_S else 1.0  # of this machine, over the usual
        return before, (self._clock() - self._since) / max(pace, 0.1)


@contextmanager
def compilation_reported(notify: Callable[[str], None], chains: Sequence[Mapping[str, float]] = ()) -> Generator[None]:
    """Report the compilation of kernels through `notify` in this context, from `FIRST_S` seconds of compiling on.

    `chains`: kernels in order of compilation with their usual processor time, s, as in `COSTS`. With them a line has
    the finished share and the time left, else the number of compiled kernels.
    """
    began, over = threading.Event(), threading.Event()
    share = CompiledShare(chains)

    def watch() -> None:
        began.wait()
        start, wait = time.monotonic(), FIRST_S
        text = "surefoot: compiling numeric kernels, half a minute or more, only this once (surefoot warm)"
        while not over.wait(wait):
            if COMPILING.busy:
                spent = time.monotonic() - start
                notify(text or _line(share, spent))
                text, wait = "", min(EACH_S, max(SECOND_S, spent))

    def note(name: str) -> None:
        share.began(name)
        began.set()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    with COMPILING.reporting(note):
        try:
            yield
        finally:
            over.set()
            began.set()
            watcher.join()


def _line(share: CompiledShare, spent: float) -> str:
    """Return a progress line: kernels, share and time left, or the time spent, s, where that is more than usual."""
    done = share.now()
    if share.late:
        return f"  compiling for {spent:.0f} s, longer than usual"
    if done < LEAST_SHARE:
        return f"  {COMPILING.done} kernels after {spent:.0f} s"
    return f"  compiling: {100.0 * done:.0f} %, about {spent * (1.0 / done - 1.0):.0f} s left"
