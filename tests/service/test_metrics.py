from ciir.service.metrics import Metrics
from tests.support.jobs import read_metrics

REPORT = {
    "timings_ms": {"decode": 1000, "total": 3000},
    "plan": {"skipped": {"pixels": 200, "uniform": 0.25}},
}


def test_results_are_counted():
    metrics = Metrics()
    metrics.count_result(123, REPORT)
    metrics.count_result(1, {"timings_ms": {}, "plan": {"skipped": {"culled": 0.5}}})
    assert read_metrics(
        metrics,
        'ciir_stage_seconds_total{stage="decode"}',
        "ciir_result_bytes_total",
        "ciir_model_pixels_total",
        "ciir_model_pixels_skipped_total",
    ) == [1, 124, 200, 50]
    assert "total" not in {sample.labels.get("stage") for each in metrics.registry.collect() for sample in each.samples}


def test_a_worker_exports_no_metrics_of_requests_and_of_the_queue():
    web, worker = ({each.name for each in made.registry.collect()} for made in (Metrics(), Metrics(of_web=False)))
    assert worker < web
    assert {name.partition("_")[2].partition("_")[0] for name in web - worker} == {"http", "queue", "jobs"}
    assert {"ciir_workers", "ciir_job_seconds", "ciir_jobs_ended"} < worker
