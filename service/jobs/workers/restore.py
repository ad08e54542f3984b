"""Restores accepted jobs whose records are lost, such as with a removed database, from copies next to their inputs."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from ciir.service.jobs.files import INPUTS, RECORD
from ciir.service.jobs.job import FINAL, Job

if TYPE_CHECKING:
    from ciir.service.jobs.jobs import Jobs

_log = logging.getLogger("ciir.jobs")


def restore_jobs(jobs: Jobs) -> None:
    """Queues each job again that has an input but no record. Raises `QueueUnavailable`."""
    stored = jobs.files.list_names(INPUTS)  # before `active`, where a job that is being submitted appears first
    active = jobs.queue.active.items()
    for name in stored:
        if name.endswith(RECORD) and name.removesuffix(RECORD) not in active:
            _restore(jobs, name)


def _restore(jobs: Jobs, name: str) -> None:
    try:
        with jobs.files.open(INPUTS, name) as file:
            job = Job.from_bytes(file.read())
    except FileNotFoundError:  # it was settled just now
        return
    except (ValueError, LookupError, TypeError) as error:
        _log.error("%s: not restored, the record is damaged or of another version (%s)", name, error)
        return
    jobs.queue.active.put(job.input, b"{}")
    if jobs.files.exists(INPUTS, job.input) and jobs.records.update(job.id, lambda now: job if now is None else None):
        _log.warning("job %s: its record was lost; queued again", job.id)
        jobs.queue.push(job.lane, job.id)
        return
    found = jobs.records.get(job.id)
    if found is None or found.input != job.input or found.state in FINAL:
        jobs.remove_input(job.input)  # left over from a process that died, or a power cut, after the job had ended
