"""Export to an OpenTelemetry collector."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import httpx2
import pytest

from tests.support.inputs import EIA_PNG
from tests.support.servers import run_server


@pytest.fixture
def collector():
    """The address of a collector, and the paths and bodies that it receives."""
    received = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["content-length"]))
            received.append((self.path, body))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_):
            """Nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}", received
        server.shutdown()
        thread.join()


@pytest.mark.slow
def test_traces_go_to_the_collector(collector, tmp_path):
    pytest.importorskip("opentelemetry.exporter.otlp.proto.http", reason="fastapi[opentelemetry] is not installed")
    url, received = collector
    settings = {"OTEL_EXPORTER_OTLP_ENDPOINT": url, "OTEL_EXPORTER_OTLP_COMPRESSION": "none", "CIIR_WORKERS": "0"}
    with run_server(tmp_path / "log", **settings, CIIR_SYNC_SECONDS="0") as server:
        files = {"file": ("a.png", EIA_PNG)}
        response = httpx2.post(f"{server.url}/v1/reconstructions", files=files, data={"lenses": "6x9"}, timeout=60)
        assert response.status_code == 202
    traces = b"".join(body for path, body in received if path == "/v1/traces")
    assert b"POST /v1/reconstructions" in traces
    assert response.headers["x-reconstruction-id"].encode() in traces
    assert any(path == "/v1/metrics" for path, _ in received)
