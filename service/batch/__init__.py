"""Reconstructions of many inputs, on all cores of this machine or on a cluster, by Dask's `distributed`.

::

    run          hands tasks to Dask, a bounded number at a time, and collects their outcomes
    engines      Dask on this machine, or the scheduler at an address
    inputs       files, globs, folders and URLs -> tasks with the names of their outputs
    work         one task, as a worker runs it: the same pipeline as `ciir reconstruct`
      trace        what a task reads, by content; so that what is done is not done again
      places       the output folder, local or in an object store: results appear there whole
      parts        large light fields and videos, cut into tasks of their own and joined
    summary      summary.json and summary.csv

A task may run twice, on two machines at once, or be killed: its result is the same and appears whole or not at all.
"""
