from contextlib import contextmanager

import pytest


@pytest.fixture(scope="module")
def workers_in_this_process():
    """Runs workers as threads of this process, which start immediately."""
    from distributed import Client, LocalCluster

    from ciir import cores
    from ciir.service.batch import engines

    @contextmanager
    def open_threads(workers, memory):
        with (
            LocalCluster(
                n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
            ) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            yield client

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engines, "open_local", open_threads)
        patch.setattr(cores, "most_cores", None)  # a worker sets it for its process
        yield
