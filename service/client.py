"""Python clients of the HTTP API, one that waits and one for asyncio.

with Client("http://127.0.0.1:8000") as client:
    client.reconstruct("duck.glb", lenses=(50, 50)).save("view.png")
    job = client.submit("views", views="all", format="npz")  # a folder
    for event in job.events():
        print(event.kind, event.data)
    views = job.result().content
    capture = client.send_file("capture.png")  # once, for several requests
    client.refocus(capture, lenses=(50, 50), disparity=1).save("near.png")

`AsyncClient` has the same methods as coroutines. All methods raise the errors of `ciir.errors`: the same errors as the
work raises without a server, and `ServiceError` for errors that only a server can cause.
"""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

import httpx2
from anyio import to_thread

from ciir.errors import ResultExpired
from ciir.service import client_messages as messages
from ciir.service.client_messages import Event, KeptFile, Result
from ciir.service.pipeline.options import KINDS

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Iterator, Mapping

    from ciir.service.client_messages import Source
    from ciir.service.pipeline.given import File
    from ciir.service.pipeline.options import KindName

__all__ = ["AsyncClient", "AsyncJob", "Client", "Event", "Job", "KeptFile", "Result"]
TIMEOUT_SECONDS = 60.0
"""Longest silence of the server, which sends at least a comment every 15 s while a job runs."""
_WAIT = {"Prefer": "wait=30"}
"""Headers of a request for a result. The server answers well before `TIMEOUT_SECONDS`, even if it would wait longer."""


class Client(httpx2.Client):
    """A connection to the server at `url`. Don't share it between threads.

    `source` is the path of a file or a folder, which is sent as a zip; `scene:NAME`; or a file's content, as bytes or
    as a file object opened for reading bytes, whose `name`, if it has one, gives the suffix. In its place, without
    sending it again: a `KeptFile` of `send_file`, or a job or a result of this server. `options` are those of the
    command, as `ciir.reconstruct` takes them: pairs as `(50, 50)`, or text as on the command line; and `format`. All
    methods raise `ciir.Error`.
    """

    def __init__(
        self,
        url: str,
        api_key: str | None = None,
        *,
        retries: int = 5,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        """`retries`: how many times a request is repeated after 429 or 503, each time after the server's `Retry-After`.

        A GET is only repeated if the response has one. While the status, events or result of a job are read, broken
        connections are made again after pauses of 1 to 15 s, 60 s in all, whatever `retries` is, unless it is 0. Then
        `ConnectionFailed` has the job's path and id, for `Client.job`. A submission is not repeated after a broken
        connection.
        """
        super().__init__(base_url=url, headers=messages.make_key(api_key), timeout=TIMEOUT_SECONDS, transport=transport)
        self.retries = retries

    def send(self, request: httpx2.Request, **options: Any) -> httpx2.Response:
        """Sends any request of this client, and repeats it as `retries` says."""
        failures = broken = 0
        while True:
            try:
                response = super().send(request, **options)
                if response.is_success:
                    return response
                response.read()
                pause = messages.find_pause(response, failures + 1, self.retries)
                failures += 1
            except httpx2.RequestError as error:
                broken += 1
                path = messages.find_job_path(request)
                pause = messages.find_reconnect_pause(self.base_url, path, error, broken, self.retries)
            time.sleep(pause)

    def send_file(self, source: File) -> KeptFile:
        """Sends a file or a folder once, for several requests: the other methods take what this returns in its place.

        The server keeps it as long as a result. If it has expired by then, it is sent again from its path, unless
        `source` was no path or its bytes have changed; then `ResultExpired` is raised.
        """
        return messages.read_kept(self._post_source("/v1/files", source, {}, {}), source)

    def reconstruct(self, source: Source, **options: object) -> Result:
        """Sends a mesh, an elemental image array or views, and waits for the views."""
        return self._run("reconstruction", source, options)

    def upscale(self, source: Source, **options: object) -> Result:
        """Sends a picture and waits for the larger one."""
        return self._run("upscale", source, options)

    def render_eia(self, source: Source, **options: object) -> Result:
        """Sends a mesh and waits for its elemental image array."""
        return self._run("elemental", source, options)

    def make_display_picture(self, source: Source, **options: object) -> Result:
        """Sends a mesh, an elemental image array or views, and waits for a display picture.

        `calibration` and `display` are paths.
        """
        return self._run("display", source, options)

    def refocus(self, source: Source, **options: object) -> Result:
        """Sends a light field or a mesh and waits for depth planes."""
        return self._run("plane", source, options)

    def disparity(self, source: Source, **options: object) -> Result:
        """Sends a light field or a mesh and waits for the disparity of a view."""
        return self._run("disparity", source, options)

    def inspect(self, source: Source, **options: object) -> dict[str, Any]:
        """Sends any file that a reconstruction takes, and returns what it contains, as `POST /v1/inspections` does."""
        return messages.read_inspection(self._run("inspection", source, options))

    def submit(self, source: Source, kind: KindName = "reconstruction", **options: object) -> Job:
        """Sends `source` and returns its job without waiting."""
        return Job(self, messages.read_path(self._post(kind, source, options, {"Prefer": "respond-async"})))

    def job(self, id_: str, kind: KindName = "reconstruction") -> Job:
        """Returns the job with that id, which any client may have submitted. Nothing is sent yet.

        `kind`: `reconstruction`, `upscale`, `elemental`, `display`, `plane`, `disparity` or `inspection`. Raises
        `InvalidOption`.
        """
        return Job(self, messages.make_path(id_, kind))

    def models(self) -> list[dict[str, Any]]:
        """Lists the models of the server."""
        return messages.read_models(self.get("/v1/models"))

    def _run(self, kind: KindName, source: Source, options: Mapping[str, object]) -> Result:
        response = self._post(kind, source, options, _WAIT)
        if response.status_code == 200:
            return messages.read_result(response)
        return Job(self, messages.read_path(response)).result()

    def _post(
        self, kind: KindName, source: Source, options: Mapping[str, object], headers: Mapping[str, str]
    ) -> httpx2.Response:
        fields = messages.write_fields(kind, options)
        path = f"/v1/{KINDS[kind].plural}"
        try:
            return self._post_source(path, source, fields, headers)
        except ResultExpired:
            kept = messages.find_path(source)
            if kept is None or self.send_file(kept) != source:
                raise
        return self._post_source(path, source, fields, headers)

    def _post_source(
        self, path: str, source: Source, fields: Mapping[str, str], headers: Mapping[str, str]
    ) -> httpx2.Response:
        field, name, file = messages.open_source(source)
        with file:
            return self.post(path, files={field: (name, file)}, data=fields, headers=headers)


class AsyncClient(httpx2.AsyncClient):
    """The same as `Client`, for asyncio. One object can serve many tasks."""

    def __init__(
        self,
        url: str,
        api_key: str | None = None,
        *,
        retries: int = 5,
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        """See `Client`."""
        super().__init__(base_url=url, headers=messages.make_key(api_key), timeout=TIMEOUT_SECONDS, transport=transport)
        self.retries = retries

    async def send(self, request: httpx2.Request, **options: Any) -> httpx2.Response:
        """See `Client.send`."""
        failures = broken = 0
        while True:
            try:
                response = await super().send(request, **options)
                if response.is_success:
                    return response
                await response.aread()
                pause = messages.find_pause(response, failures + 1, self.retries)
                failures += 1
            except httpx2.RequestError as error:
                broken += 1
                path = messages.find_job_path(request)
                pause = messages.find_reconnect_pause(self.base_url, path, error, broken, self.retries)
            await asyncio.sleep(pause)

    async def send_file(self, source: File) -> KeptFile:
        """See `Client.send_file`."""
        return messages.read_kept(await self._post_source("/v1/files", source, {}, {}), source)

    async def reconstruct(self, source: Source, **options: object) -> Result:
        """See `Client.reconstruct`."""
        return await self._run("reconstruction", source, options)

    async def upscale(self, source: Source, **options: object) -> Result:
        """See `Client.upscale`."""
        return await self._run("upscale", source, options)

    async def render_eia(self, source: Source, **options: object) -> Result:
        """See `Client.render_eia`."""
        return await self._run("elemental", source, options)

    async def make_display_picture(self, source: Source, **options: object) -> Result:
        """See `Client.make_display_picture`."""
        return await self._run("display", source, options)

    async def refocus(self, source: Source, **options: object) -> Result:
        """See `Client.refocus`."""
        return await self._run("plane", source, options)

    async def disparity(self, source: Source, **options: object) -> Result:
        """See `Client.disparity`."""
        return await self._run("disparity", source, options)

    async def inspect(self, source: Source, **options: object) -> dict[str, Any]:
        """See `Client.inspect`."""
        return messages.read_inspection(await self._run("inspection", source, options))

    async def submit(self, source: Source, kind: KindName = "reconstruction", **options: object) -> AsyncJob:
        """See `Client.submit`."""
        return AsyncJob(self, messages.read_path(await self._post(kind, source, options, {"Prefer": "respond-async"})))

    def job(self, id_: str, kind: KindName = "reconstruction") -> AsyncJob:
        """See `Client.job`. Not a coroutine."""
        return AsyncJob(self, messages.make_path(id_, kind))

    async def models(self) -> list[dict[str, Any]]:
        """See `Client.models`."""
        return messages.read_models(await self.get("/v1/models"))

    async def _run(self, kind: KindName, source: Source, options: Mapping[str, object]) -> Result:
        response = await self._post(kind, source, options, _WAIT)
        if response.status_code == 200:
            return messages.read_result(response)
        return await AsyncJob(self, messages.read_path(response)).result()

    async def _post(
        self, kind: KindName, source: Source, options: Mapping[str, object], headers: Mapping[str, str]
    ) -> httpx2.Response:
        fields = messages.write_fields(kind, options)
        path = f"/v1/{KINDS[kind].plural}"
        try:
            return await self._post_source(path, source, fields, headers)
        except ResultExpired:
            kept = messages.find_path(source)
            if kept is None or await self.send_file(kept) != source:
                raise
        return await self._post_source(path, source, fields, headers)

    async def _post_source(
        self, path: str, source: Source, fields: Mapping[str, str], headers: Mapping[str, str]
    ) -> httpx2.Response:
        field, name, file = await to_thread.run_sync(messages.open_source, source)
        with file:
            return await self.post(path, files={field: (name, file)}, data=fields, headers=headers)


class Job(messages.JobPath):
    """A job of a server."""

    def __init__(self, client: Client, path: str) -> None:
        super().__init__(path)
        self._client = client

    def status(self) -> dict[str, Any]:
        """Returns the job's status, as answered by `GET` of its path."""
        return messages.read_status(self._client.get(self.path))

    def events(self) -> Iterator[Event]:
        """Yields all events from the first to the last. Reconnects as `retries` of `Client` says."""
        cursor = messages.Cursor(self.path, self._client.retries)
        while not cursor.is_at_end:
            pause = messages.PAUSE_SECONDS
            try:
                with self._client.sse(f"{self.path}/events", headers=cursor.headers) as events:
                    cursor.begin(events.response)
                    for event in events:
                        if (found := cursor.take(event)) is not None:
                            yield found
            except httpx2.RequestError as error:
                pause = cursor.find_pause(self._client.base_url, error)
            if not cursor.is_at_end:
                time.sleep(pause)

    def result(self) -> Result:
        """Waits for the result. Raises `ciir.Error` if the job fails or is cancelled."""
        for _ in self.events():
            pass
        return messages.read_result(self._client.get(f"{self.path}/result"))

    def cancel(self) -> dict[str, Any]:
        """Cancels the job, or removes one that has ended, and returns its last status.

        The job goes on if another client has asked for the same.
        """
        return messages.read_status(self._client.delete(self.path))


class AsyncJob(messages.JobPath):
    """The same as `Job`, for asyncio."""

    def __init__(self, client: AsyncClient, path: str) -> None:
        super().__init__(path)
        self._client = client

    async def status(self) -> dict[str, Any]:
        """See `Job.status`."""
        return messages.read_status(await self._client.get(self.path))

    async def events(self) -> AsyncIterator[Event]:
        """See `Job.events`."""
        cursor = messages.Cursor(self.path, self._client.retries)
        while not cursor.is_at_end:
            pause = messages.PAUSE_SECONDS
            try:
                async with self._client.sse(f"{self.path}/events", headers=cursor.headers) as events:
                    cursor.begin(events.response)
                    async for event in events:
                        if (found := cursor.take(event)) is not None:
                            yield found
            except httpx2.RequestError as error:
                pause = cursor.find_pause(self._client.base_url, error)
            if not cursor.is_at_end:
                await asyncio.sleep(pause)

    async def result(self) -> Result:
        """See `Job.result`."""
        async for _ in self.events():
            pass
        return messages.read_result(await self._client.get(f"{self.path}/result"))

    async def cancel(self) -> dict[str, Any]:
        """See `Job.cancel`."""
        return messages.read_status(await self._client.delete(self.path))
