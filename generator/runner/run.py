"""Generating a dataset: plan, make what is missing, retry what failed, finish the set."""

from __future__ import annotations

import functools
import logging
import os
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Final, Literal

from pliant.generator.config import BLENDER_STYLES, GenerateConfig
from pliant.generator.runner.engine import Engine, Finished, OpenMaker, Rendered
from pliant.generator.runner.manifest import RUN_DIR, Failure, RunFolder, refuse_changes
from pliant.generator.runner.plan import Plan, plan_run
from pliant.generator.runner.progress import Forecast, RunState, Summary
from pliant.generator.seeding import SequenceTask
from pliant.spec.cores import cpu_cores
from pliant.spec.errors import CallError, GenerationError
from pliant.spec.extras import require_packages
from pliant.spec.storage.layout import DATASET_JSON

ATTEMPTS: Final = 3
"""How often a sequence is tried before it is recorded as failed."""

ENGINES: Final = ("local", "ray")

logger = logging.getLogger("pliant.generator")


def generate(
    config: GenerateConfig,
    out: Path | str,
    *,
    workers: int = 1,
    engine: Literal["local", "ray"] | Engine = "local",
    progress: Callable[[RunState], None] | None = None,
    open_maker: OpenMaker | None = None,
) -> Summary:
    """Make a dataset, or go on with one.

    What is there already is kept: the same call after an interruption makes what is missing,
    and on a finished set does nothing. A sequence whose files differ from the sizes and checksums
    of its `sequence.json` is made again. The bytes depend on the config alone, not on engine,
    workers, order or interruptions.

    Args:
        config: What to make.
        out: The dataset's folder: new, empty, or begun by an earlier call.
        workers: Sequences in work at a time, >= 1.
        engine: `local`, `ray`, or an engine object.
        progress: Called at the start and after every event.
        open_maker: What makes the sequences in a worker, picklable; None renders them.

    Returns:
        What was done. Sequences that failed are listed, and the set contains the others.

    Raises:
        CallError: The folder contains something else, or a set made with other settings.
        MissingExtraError: Numba, or for its styles Blender, is not installed.
        GenerationError: The disk is full or the folder cannot be written: nothing more can be
            done, and nothing that was finished is lost.
    """
    root = Path(out)
    check_call(config, workers, open_maker)
    started = time.monotonic()
    run = RunFolder(root)
    run.open()
    with run.locked(), _logged(run) as log:
        plan = plan_run(config, root)
        whole = not plan.missing and (root / DATASET_JSON).is_file()
        if whole and run.is_finished(config):
            run.clear_partial()
            return Summary(root, len(plan.tasks), 0, 0, 0, time.monotonic() - started)
        config = _begin(run, config, plan)
        missing, frames = plan.missing, config.frames
        forecast = Forecast.of(missing, frames, workers)
        state = RunState(plan, len(plan.finished), len(missing) * frames, forecast, log=log)
        failed: list[Failure] = []
        if plan.missing:
            chosen = _open_engine(engine, workers, log, config.style)
            threads = max(1, cpu_cores() // chosen.workers)  # so that workers do not fight
            maker = open_maker or sequence_maker(config, root, threads)
            show = progress or (lambda _: None)
            try:
                failed = _make_missing(root, plan, chosen, maker, state, show)
            finally:
                run.clear_partial()
        tasks = _finish(run, config, plan, failed, log)
        return Summary(
            root=root,
            sequences=len(tasks),
            made=state.sequences - len(plan.finished),
            frames=state.frames,
            bytes=state.bytes,
            seconds=time.monotonic() - started,
            failed=tuple(failed),
        )


def _begin(run: RunFolder, config: GenerateConfig, plan: Plan) -> GenerateConfig:
    """Bind the folder to a config and clear what earlier runs left unfinished.

    Returns:
        The config, with the secret seed if it has one.

    Raises:
        CallError: The folder contains a set made with other settings, or has lost its seed.
    """
    stored = run.stored_config()
    if stored is not None:
        refuse_changes(stored, config.resolved(), run.root)
    if config.secret_seed:
        config = config.replace(seed=run.secret_seed(begun=stored is not None))
    run.store_config(config, finished=False)
    for task in plan.tasks:
        if task.id in plan.damaged:
            logger.warning("%s is made again: %s", task.id, plan.damaged[task.id])
            shutil.rmtree(task.folder(run.root))
    run.clear_partial()
    logger.info("%d of %d sequences to make in %s", len(plan.missing), len(plan.tasks), run.root)
    return config


def _finish(
    run: RunFolder, config: GenerateConfig, plan: Plan, failed: list[Failure], log: Path
) -> list[SequenceTask]:
    """Write the dataset's own files over the sequences that could be made, and return these.

    Raises:
        GenerationError: There is none, or the files cannot be written.
    """
    from pliant.generator.runner.dataset_files import write_dataset_files

    run.store_failures(failed)
    missing = {failure.id for failure in failed}
    tasks = [task for task in plan.tasks if task.id not in missing]
    if not tasks:
        raise GenerationError(
            "no sequence could be made", path=log, found=failed[0].error.splitlines()[-1]
        )
    try:
        write_dataset_files(config, tasks, run.root)
        run.store_config(config, finished=True)
    except CallError as error:
        raise GenerationError(
            "the dataset's tables cannot be written",
            path=run.root,
            found=error.found,
            fix=_kept(len(tasks), len(plan.tasks)),
        ) from error
    logger.info("finished: %d sequences, %d failed", len(tasks), len(failed))
    return tasks


def _make_missing(
    root: Path,
    plan: Plan,
    engine: Engine,
    open_maker: OpenMaker,
    state: RunState,
    show: Callable[[RunState], None],
) -> list[Failure]:
    """Make the missing sequences; those that fail are tried again after all others.

    An error that follows from the settings would be the same again, and is not tried again.
    """
    tasks = plan.missing
    failed: dict[str, Failure] = {}
    unfinished: Counter[str] = Counter()  # frames of the sequences in work
    show(state)
    for number in range(1, ATTEMPTS + 1):
        again: list[SequenceTask] = []
        with closing(engine.events(tasks, open_maker)) as events:
            for event in events:
                if isinstance(event, Rendered):
                    state.frames += event.frames
                    unfinished[event.task.id] += event.frames
                elif isinstance(event, Finished):
                    _require_here(root, event)
                    _count(state, event)
                    failed.pop(event.task.id, None)
                else:
                    state.failures += 1
                    state.frames -= unfinished.pop(event.task.id, 0)
                    logger.error("%s, attempt %d: %s", event.task.id, number, event.error)
                    if event.fatal is not None:
                        raise GenerationError(
                            "the run cannot continue",
                            where=event.task.id,
                            found=event.fatal,
                            fix=_kept(state.sequences, len(plan.tasks)),
                        )
                    if not event.settled:
                        again.append(event.task)
                    failed[event.task.id] = Failure(event.task.id, number, event.error)
                show(state)
        if not again:
            break
        tasks = again
    return list(failed.values())


def _require_here(root: Path, event: Finished) -> None:
    """Check that what another node may have written can be seen here."""
    if not (root / RUN_DIR).is_dir():
        raise GenerationError(
            "the output folder was moved or removed during the run",
            path=root,
            fix="Run the command again with the new path; finished sequences are kept.",
        )
    folder = event.task.folder(root)
    if not folder.is_dir():
        raise GenerationError(
            "a worker finished this sequence, but its folder was not found",
            path=folder,
            fix="With --engine ray the output must be on a file system that all nodes share",
        )


def _count(state: RunState, event: Finished) -> None:
    result = event.result
    state.sequences += 1
    state.bytes += result.bytes
    state.memory_bytes = max(state.memory_bytes, result.memory_bytes)
    state.forecast.finish(event.task.tier, result)
    stages = ", ".join(f"{stage} {spent:.3f}" for stage, spent in result.stage_cpu_s.items())
    logger.info(
        "%s: %d frames, %.2f s, %.2f CPU s (%s), %.0f MB resident, %d bytes",
        result.id,
        result.frames,
        result.seconds,
        result.cpu_s,
        stages,
        result.memory_bytes / 1e6,
        result.bytes,
    )


def _kept(finished: int, wanted: int) -> str:
    return (
        f"{finished} of {wanted} sequences are finished and kept: make room or correct the "
        "folder's permissions, and give the same command again"
    )


def _open_engine(engine: str | Engine, workers: int, log: Path, style: str) -> Engine:
    if not isinstance(engine, str):
        return engine
    # Imported here: a finished set gets an error that says so without them.
    if engine == "local":
        from pliant.generator.runner.engine_local import LocalEngine, visible_gpus

        return LocalEngine(workers, log, visible_gpus() if style in BLENDER_STYLES else ())
    if engine == "ray":
        from pliant.generator.runner.engine_ray import RayEngine

        return RayEngine(workers, None if style in BLENDER_STYLES else 0.0)
    raise CallError(
        "unknown engine", where="engine", found=engine, required="one of " + ", ".join(ENGINES)
    )


def check_call(config: GenerateConfig, workers: int, open_maker: OpenMaker | None) -> None:
    """Refuse a call without workers, or without the packages that render a style.

    Raises:
        CallError: The number of workers is less than 1.
        MissingExtraError: Numba, or for its styles Blender, is not installed.
    """
    if workers < 1:
        raise CallError(
            "invalid number of workers", where="workers", found=workers, required=">= 1"
        )
    if open_maker is None:
        require_packages(required_packages(config.style), "generating a dataset", "generate")


def sequence_maker(config: GenerateConfig, root: Path, threads: int = 1) -> OpenMaker:
    """Return what opens the real maker in a worker: picklable."""
    from pliant.generator.runner.sequence import SequenceMaker  # brings Numba

    return functools.partial(SequenceMaker, config, root, threads=threads)


def required_packages(style: str) -> list[str]:
    """Return the import names of the optional packages that a style needs."""
    return ["numba", "psutil", "platformdirs", "filelock"] + ["bpy"] * (style in BLENDER_STYLES)


@contextmanager
def _logged(run: RunFolder) -> Iterator[Path]:
    """Send this package's log to a file of the run while it lasts."""
    path = run.logs / time.strftime(f"run-%Y%m%d-%H%M%S-{os.getpid()}.log", time.gmtime())
    handler = _LogFile(path, delay=True)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield path
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()


class _LogFile(logging.FileHandler):
    """A log file whose own write errors, such as a full disk, are ignored."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Drop the record: its traceback on stderr would bury the error of the run."""

    def close(self) -> None:
        """Close the file, even if its last lines cannot be written."""
        with suppress(OSError):
            super().close()
