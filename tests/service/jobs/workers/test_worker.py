from ciir.service.jobs.workers.worker import make_environment


def test_linear_algebra_has_one_thread_unless_the_variable_is_set(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    assert make_environment()["OPENBLAS_NUM_THREADS"] == "1"
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    assert make_environment()["OPENBLAS_NUM_THREADS"] == "3"


def test_workers_find_networks_of_ones_own(monkeypatch, tmp_path):
    """Their current folder is another one."""
    monkeypatch.delenv("CIIR_MODELS", raising=False)
    assert "CIIR_MODELS" not in make_environment()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CIIR_MODELS", "own")
    assert make_environment()["CIIR_MODELS"] == str(tmp_path / "own")
