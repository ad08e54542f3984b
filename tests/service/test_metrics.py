from ciir.service.metrics import Metrics
from tests.support.jobs import read_metrics

REPORT = {
    "timings_ms": {"decode": 1000, "total": 3000},
    "plan": {"skipped": {"pixels": 200, "uniform": 0.25, "repeated": 0.5}},
}


def test_results_are_counted():
    metrics = Metrics()
    metrics.count_result(123, REPORT)
    metrics.count_result(1, {"timings_ms": {}, "plan": {"skipped": {"culled": 0.5}}})
    assert read_metrics(
        metrics,
        'ciir_stage_seconds_total{stage="total"}',
        "ciir_result_bytes_total",
        "ciir_model_pixels_total",
        'ciir_model_pixels_skipped_total{reason="repeated"}',
    ) == [3, 124, 200, 100]
