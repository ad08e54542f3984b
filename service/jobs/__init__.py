"""Reconstructions as jobs: a durable queue, a record of each job, its files, and the worker processes that run it.

::

    engine            the jobs, the consumer and the worker processes of one server
    jobs              submit, look up, wait for, cancel, fetch and expire jobs
      identity, lanes   the id of a request; which of the two queues a job waits in
      queue, records    storage in SQLite or Redis; one record per job, changed by compare and swap
      lifecycle         the changes of state of a job, from queued to its end
      files             inputs and results, in a folder or an object store
      disk              whether there is room for another upload
    workers/
      consumer          threads that take jobs off the queue and run each in a worker process
      recovery          finds jobs whose consumer died and runs them again
      restore           queues jobs again whose records are lost
      pool, worker      the worker processes, and one of them with its messages, as seen from the parent
      process, task     the program of a worker process, and the task that it runs
      progress          the stages and views that a task reports
      sandbox           what a worker process is not allowed to do

No job is lost when a process is killed or the power fails. A job and its input are on the disk before `submit` returns,
and its result is on the disk before the job is done. Every change is a compare and swap, and each run has its own lease
and its own files. A consumer that was declared dead and resumes cannot change the job.
"""
