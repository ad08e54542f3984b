"""Reconstructs many inputs, on all cores of this machine or on a cluster, with Dask's `distributed`.

::

    run          passes tasks to Dask, a bounded number at a time, and collects their outcomes
    engines      Dask on this machine, or the scheduler at an address
    inputs       files, globs, folders and URLs -> tasks with the names of their outputs
    work         one task, as a worker runs it: the same pipeline as `ciir reconstruct`
      trace        what a task reads, by content, so that finished work is not done again
      places       the output folder, local or in an object store; results appear there whole
      parts        large light fields and videos, cut into separate tasks and joined
    summary      summary.json and summary.csv

A task may run twice, on two machines at once, or be killed. Its result is the same, and appears whole or not at all.
"""
