import asyncio
import errno
from tempfile import gettempdir

import pytest
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.requests import Request

from ciir.errors import NoRoom
from ciir.service.jobs.resource import DISK_FULL
from ciir.service.web import multipart

FILE = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\nabc\r\n'
FIELD = b'--b\r\nContent-Disposition: form-data; name="views"\r\n\r\n%s\r\n'
END = b"--b--\r\n"


def read(body, content_type="multipart/form-data; boundary=b"):
    async def receive():
        return {"type": "http.request", "body": body, "more_body": False}

    async def list_names():
        scope = {"type": "http", "method": "POST", "headers": [(b"content-type", content_type.encode())]}
        form = await multipart.read_form(Request(scope, receive))
        names = list(form)
        await form.close()
        return names

    return asyncio.run(list_names())


def test_complete_bodies():
    assert read(FILE + FIELD % b"all" + END) == ["file", "views"]
    assert read(END) == []
    assert read(FILE + b"--b--") == ["file"]
    assert read(FILE + END + b"an epilogue") == ["file"]


@pytest.mark.parametrize(
    ("body", "message", "remedy"),
    [
        (FILE[:-3], "before its closing boundary", "the whole body"),
        (FILE, "before its closing boundary", "the whole body"),
        (FILE + FIELD[:20], "before its closing boundary", "the whole body"),
        (b"", "before its closing boundary", "the whole body"),
        (b"nonsense", "Invalid multipart data", "curl -F"),
        (FILE.replace(b"name=", b"nome=", 1).replace(b"; filename", b"; file") + END, "name", "curl -F"),
        (FILE.replace(b'"a"', b'"%s"' % bytes(5000)) + END, "over 4,224 bytes", "a shorter name"),
        (4 * FILE + END, "Too many files.*3", "a zip"),
        (FIELD % b"x" * 65 + END, "Too many fields.*64", "once"),
        (FIELD % bytes(multipart.MAX_FIELD_BYTES + 1) + END, "maximum size of 64KB", "fewer views"),
    ],
)
def test_every_error_has_a_remedy(body, message, remedy):
    with pytest.raises(HTTPException) as caught:
        read(body)
    assert caught.value.status_code == 400
    assert caught.match(message)
    assert remedy in caught.value.detail.partition("; ")[2]


PLAIN = "application/x-www-form-urlencoded"


def test_forms_without_a_file():
    assert read(b"scene=vase&views=%30%3A2&x", PLAIN) == ["scene", "views", "x"]
    assert read(b"", f"{PLAIN}; charset=UTF-8") == []
    assert read(b"views=".ljust(multipart.MAX_FIELD_BYTES, b"0"), PLAIN) == ["views"]
    assert read("Über+uns&%C3%9Cber%20sie".encode(), PLAIN) == ["Über uns", "Über sie"]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"views=".ljust(multipart.MAX_FIELD_BYTES + 1, b"0"), "is UTF-8 text of up to 65,536 bytes; .*curl -F"),
        (b"a file\0", "is UTF-8 text"),
        (b"a=%00", "is UTF-8 text"),
        (b"a=%FF", "is UTF-8 text"),
        (b"a=b&" * (multipart.MAX_FIELDS + 1), "Too many fields.*64; send each option once"),
    ],
)
def test_limits_of_forms_without_a_file(body, message):
    with pytest.raises(HTTPException, match=message) as caught:
        read(body, PLAIN)
    assert caught.value.status_code == 400


def test_no_boundary():
    with pytest.raises(HTTPException, match=r"boundary.*; let the HTTP client"):
        read(FILE + END, "multipart/form-data")


def test_a_full_disk(monkeypatch, caplog):
    def write(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(UploadFile, "write", write)
    with pytest.raises(NoRoom, match=DISK_FULL):
        read(FILE + END)
    assert caplog.messages == [f"an upload can't be kept in {gettempdir()} (TMPDIR): No space left on device"]


@pytest.mark.parametrize("charset", ["utf-8", "UTF-8", '"us-ascii"'])
def test_a_charset_of_forms(charset):
    assert read(FILE + END, f"multipart/form-data; boundary=b; charset={charset}") == ["file"]


@pytest.mark.parametrize("charset", ["undefined", "utf-7", "idna", "unicode_escape", "latin-1", '"\x01"', '""'])
def test_no_other_charset_reaches_a_decoder(charset):
    with pytest.raises(HTTPException, match=r"^400: charset=.*: not supported; send the form in UTF-8$"):
        read(FILE + END, f"multipart/form-data; boundary=b; charset={charset}")
