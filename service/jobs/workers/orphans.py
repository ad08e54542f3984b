"""Removes files that belong to no job, such as those of a process that died while it wrote them."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from ciir.service.jobs.files import INPUTS, RECORD, RESULTS
from ciir.service.jobs.job import parse_id

if TYPE_CHECKING:
    from ciir.service.jobs.jobs import Jobs

ORPHAN_SECONDS = 86_400.0


def remove_orphaned_files(jobs: Jobs) -> None:
    """Removes files without a job that are older than both `Jobs.keep_seconds` and `ORPHAN_SECONDS`.

    Raises `QueueUnavailable`.
    """
    files = jobs.files
    results = files.list_names(RESULTS)  # before the jobs, which are stored before their results and removed after them
    found = jobs.records.get_many([parse_id(name) for name in results])
    outputs = {job.output for job in found.values()}
    inputs = files.list_names(INPUTS)
    active = jobs.queue.active.items()
    orphans = [(RESULTS, name) for name in results if name not in outputs]
    orphans += [(INPUTS, name) for name in inputs if name.removesuffix(RECORD) not in active]
    for folder, name in orphans:
        with suppress(FileNotFoundError):
            if files.get_age(folder, name) > max(jobs.keep_seconds, ORPHAN_SECONDS):
                files.remove(folder, name)
