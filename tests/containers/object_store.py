"""An S3 server in memory, as much of it as files need: put, get, head, list and delete."""

from __future__ import annotations

import re
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, unquote, urlsplit
from xml.sax.saxutils import escape

DATE = "2026-01-01T00:00:00.000Z"
ACCESS = {
    "AWS_ACCESS_KEY_ID": "id",
    "AWS_SECRET_ACCESS_KEY": "secret",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_EC2_METADATA_DISABLED": "true",
}


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def _respond(self, code, body=b"", **headers):
        self.send_response(code)
        for name, value in ({"Content_Length": str(len(body))} | headers).items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def _read(self):
        url = urlsplit(self.path)
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        return unquote(url.path).strip("/"), parse_qs(url.query, keep_blank_values=True), body

    def do_PUT(self):
        key, _, body = self._read()
        if "/" in key:
            self.server.objects[key] = body
        self._respond(200, ETag='"x"')

    def do_HEAD(self):
        key, _, _ = self._read()
        if "/" in key and key not in self.server.objects:
            return self._respond(404)
        size = str(len(self.server.objects.get(key, b"")))
        return self._respond(200, Content_Length=size, Last_Modified="Thu, 01 Jan 2026 00:00:00 GMT", ETag='"x"')

    def do_GET(self):
        key, query, _ = self._read()
        if "list-type" in query:
            return self._respond(200, self._list(key, query), Content_Type="application/xml")
        if key not in self.server.objects:
            return self._respond(404, b"<Error><Code>NoSuchKey</Code></Error>", Content_Type="application/xml")
        body = self.server.objects[key]
        found = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        if found is None:
            return self._respond(200, body, ETag='"x"')
        first, last = int(found[1]), min(int(found[2] or len(body)), len(body) - 1)
        if first >= len(body):
            return self._respond(416)
        return self._respond(206, body[first : last + 1], Content_Range=f"bytes {first}-{last}/{len(body)}", ETag='"x"')

    def _list(self, bucket, query):
        prefix, delimiter = query.get("prefix", [""])[0], query.get("delimiter", [""])[0]
        start = f"{bucket}/"
        names = {key.removeprefix(start): data for key, data in self.server.objects.items() if key.startswith(start)}
        names = {name: data for name, data in sorted(names.items()) if name.startswith(prefix)}
        folders = set()
        if delimiter:
            folders = {
                prefix + name[len(prefix) :].partition("/")[0] + "/" for name in names if "/" in name[len(prefix) :]
            }
            names = {name: data for name, data in names.items() if "/" not in name[len(prefix) :]}
        contents = "".join(
            f"<Contents><Key>{escape(name)}</Key><Size>{len(data)}</Size><LastModified>{DATE}</LastModified></Contents>"
            for name, data in names.items()
        )
        common = "".join(
            f"<CommonPrefixes><Prefix>{escape(name)}</Prefix></CommonPrefixes>" for name in sorted(folders)
        )
        return f"<ListBucketResult><IsTruncated>false</IsTruncated>{contents}{common}</ListBucketResult>".encode()

    def do_DELETE(self):
        key, _, _ = self._read()
        self.server.objects.pop(key, None)
        self._respond(204)

    def do_POST(self):
        bucket, _, body = self._read()
        for name in re.findall(r"<Key>(.*?)</Key>", body.decode()):
            self.server.objects.pop(f"{bucket}/{name}", None)
        self._respond(200, b"<DeleteResult></DeleteResult>", Content_Type="application/xml")

    def log_message(self, *words):
        pass


@contextmanager
def run_store():
    """Yields (the environment by which botocore reaches it, its objects by bucket and key)."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Handler) as server:
        server.objects = {}
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield ACCESS | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}"}, server.objects
        finally:
            server.shutdown()
            thread.join()
