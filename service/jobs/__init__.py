"""Reconstructions that are asked for, waited for and looked up under their content's hash: a durable queue, what is
known of each job, its input and result, and the worker processes that do the work.

::

    jobs      what those who ask see: submit, get, changes, cancel, open_result, sweep
      identity, lanes         which requests are the same; which of two queues one waits in
      queue, records, runs    where jobs wait and are kept; changed one at a time; the steps from queued to done
      files                   inputs and results, in a folder or an object store
    consumer  takes jobs off the queue: threads, each of which has a worker process do one
      watch, owner            what has died is run again
      pool, work, sandbox     worker processes, what they do, and what they may not

Nothing here knows of HTTP, and nothing is lost when a process is killed: a job is kept from `submit` on, each change is
a compare and swap, each run has a claim of its own and files that no other run shares. So the run of a consumer that
was taken for dead and comes back changes nothing.
"""
