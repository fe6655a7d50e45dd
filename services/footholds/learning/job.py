"""Learning of a model on a thread of its own, while ticks and requests go on; one job at a time."""

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path

from surefoot.errors import Refusal, SurefootError
from surefoot.schemas.footholds import LearnReply, LearnRequest

from ..models.files import save
from ..models.learned import LearnedModel
from .fit import LearnOptions, candidates, learn_and_compare
from .samples import SampleSet, gather, read_lines

MAX_SAMPLE_BYTES = 2_000_000_000
"""Largest size of a file of samples, bytes; a larger file is refused."""


@dataclass(eq=False)
class LearnJob:
    """Learning job of the foothold service, which runs on a thread of its own."""

    number: int = 0
    state: LearnReply = field(default_factory=lambda: LearnReply(state="idle"))
    _thread: threading.Thread | None = None
    _cancel: threading.Event = field(default_factory=threading.Event)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _finished: LearnedModel | None = None
    _past: int = 0
    """Number of the last job before a reset: models of jobs up to this one are not put into use."""

    def answer(self, request: LearnRequest) -> LearnReply:
        """Start or cancel the learning job as the request's `action` demands; return the state of the job.

        Raises:
            Refusal: a start while a job runs, or without a file of samples; a cancel without a running job.
        """
        running = self._thread is not None and self._thread.is_alive()
        if request.action == "start":
            if running:
                raise Refusal("busy", f"job {self.number} is still learning", "action")
            if not request.samples:
                raise Refusal("invalid", "start needs the path of a file of samples", "samples")
            self._start(request)
        elif request.action == "cancel":
            if not running:
                raise Refusal("nothing_to_cancel", f"no job is running, the last is {self.state.state}", "action")
            self._cancel.set()
        with self._lock:
            return self.state

    def take(self) -> LearnedModel | None:
        """Return the model of a finished job that is to be used from now on, once; None = there is none."""
        with self._lock:
            found, self._finished = self._finished, None
        return found

    def forget(self) -> None:
        """Drop the models of all jobs started so far, as after a reset; jobs that still run write their files."""
        with self._lock:
            self._past, self._finished = self.number, None

    def close(self) -> None:
        """Cancel the learning job and wait for its thread."""
        self._cancel.set()
        if self._thread is not None:
            self._thread.join()

    def wait(self) -> None:
        """Wait for the end of the job."""
        if self._thread is not None:
            self._thread.join()

    def _start(self, request: LearnRequest) -> None:
        self.number += 1
        self._cancel = threading.Event()
        self.state = LearnReply(state="running", job=self.number)
        run = (request, self.number, self._cancel)
        self._thread = threading.Thread(target=self._run, args=run, name="learn", daemon=True)
        self._thread.start()

    def _set(self, **changes: object) -> None:
        with self._lock:
            self.state = self.state.model_copy(update=changes)

    def _run(self, request: LearnRequest, number: int, cancel: threading.Event) -> None:
        try:
            samples = read_samples(Path(request.samples))
            self._set(samples=len(samples), refused=samples.refused)
            tried = candidates(request.terms)
            options = replace(
                LearnOptions(), title=request.title, folds=request.folds, seed=request.seed, candidates=tried,
                distance_weight=request.distance_weight, landing_error=request.landing_error,
            )  # fmt: skip

            def report(share: float) -> bool:
                self._set(progress=share)
                return not cancel.is_set()

            model, beside = learn_and_compare(samples, options, report)
            if request.out:
                save(model, request.out)
            with self._lock:
                self._finished = model if request.use and number > self._past else None
            self._set(
                state="done", progress=1.0, model=model.name, error=model.choice["error"],
                better=not beside.warning, warning=beside.warning,
            )  # fmt: skip
        except SurefootError as error:
            ended = "cancelled" if error.code == "cancelled" else "failed"
            self._set(state=ended, code=error.code, reason=error.message)
        except Exception as error:  # any other error ends the job, not the service
            self._set(state="failed", code="internal", reason=repr(error))


def read_samples(path: Path) -> SampleSet:
    """Return the samples of a file that can be learned from, with counts of those left out.

    Raises:
        SurefootError: the file cannot be read or is too large.
    """
    try:
        size = path.stat().st_size
        if size > MAX_SAMPLE_BYTES:
            raise SurefootError(
                "too_large", f"{path.name} has {size} bytes, at most {MAX_SAMPLE_BYTES} are allowed", "samples"
            )
        with path.open(encoding="utf-8", errors="replace") as stream:
            found, _, bad = read_lines(stream)
    except OSError as error:
        raise SurefootError("unreadable", f"{str(path)!r} cannot be read: {error.strerror}", "samples") from None
    samples = gather(found)
    if bad:
        samples.refused["unreadable_lines"] = bad
    return samples
