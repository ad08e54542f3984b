from ciir.service.jobs.workers.worker import make_environment


def test_linear_algebra_has_one_thread_unless_the_variable_is_set(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    assert make_environment()["OPENBLAS_NUM_THREADS"] == "1"
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    assert make_environment()["OPENBLAS_NUM_THREADS"] == "3"
