import hashlib
import io
import logging
import shutil

import pytest
from fsspec.implementations.memory import MemoryFileSystem

from ciir.errors import InvalidOption, QueueUnavailable
from ciir.service.jobs import files as module
from ciir.service.jobs.files import CHUNK, INPUTS, RESULTS, Files, hash_content

DATA = bytes(range(256)) * 10


@pytest.fixture(params=["folder", "store"])
def files(request, tmp_path):
    place = str(tmp_path / "files") if request.param == "folder" else f"memory://{tmp_path.name}/files"
    return Files(place, tmp_path / "scratch")


@pytest.fixture
def local_files(tmp_path):
    return Files(str(tmp_path / "files"), tmp_path)


def read(files, folder, name):
    with files.open(folder, name) as file:
        return file.read()


def test_a_file_is_written_read_and_removed(files):
    file = io.BytesIO(DATA)
    file.seek(100)
    files.put(INPUTS, {"a": file})
    assert files.exists(INPUTS, "a")
    assert not files.exists(RESULTS, "a")
    assert read(files, INPUTS, "a") == DATA
    assert 0 <= files.get_age(INPUTS, "a") < 60
    assert (files.list_names(INPUTS), files.list_names(RESULTS)) == (["a"], [])
    files.remove(INPUTS, "a")
    files.remove(INPUTS, "a")
    assert not files.exists(INPUTS, "a")
    with pytest.raises(FileNotFoundError):
        files.open(INPUTS, "a")


def test_all_of_a_long_file_is_hashed_and_it_is_rewound():
    data = bytearray(3 * CHUNK)
    before = hash_content(io.BytesIO(data))
    data[-1] = 1
    file = io.BytesIO(data)
    file.seek(5)
    assert hash_content(file) == hashlib.sha256(data).hexdigest() != before
    assert file.tell() == 0


def test_a_file_whose_bytes_changed_does_not_match(files):
    sha256 = hashlib.sha256(DATA).hexdigest()
    assert not files.matches(RESULTS, "a", len(DATA), sha256)
    for data in (DATA, DATA[:-1], DATA[:-1] + b"x", b"", DATA):
        files.put(RESULTS, {"a": io.BytesIO(data)})
        assert files.matches(RESULTS, "a", len(DATA), sha256) == (data == DATA)


def test_a_file_is_read_once_to_check_it(files, monkeypatch):
    files.put(RESULTS, {"a": io.BytesIO(DATA)})
    opened = []
    open_file = files._fs.open
    monkeypatch.setattr(files._fs, "open", lambda path, mode: opened.append(path) or open_file(path, mode))
    for _ in range(3):
        assert files.matches(RESULTS, "a", len(DATA), hashlib.sha256(DATA).hexdigest())
    assert len(opened) == 1


def test_a_damaged_input_is_not_run(files):
    files.put(INPUTS, {"a": io.BytesIO(DATA[:-1])})
    with pytest.raises(FileNotFoundError, match="SHA-256"), files.open_run("a", "b", hashlib.sha256(DATA).hexdigest()):
        pass
    assert files.list_runs() == []


def test_a_folder_that_was_removed_is_reported(local_files, tmp_path):
    local_files.put(INPUTS, {"a": io.BytesIO(DATA)})
    shutil.rmtree(tmp_path / "files")
    with pytest.raises(QueueUnavailable, match="No such file"):
        local_files.put(INPUTS, {"b": io.BytesIO(DATA)})
    with pytest.raises(QueueUnavailable, match="No such file"), local_files.open_run("a", "b"):
        pass


def test_a_run_publishes_its_result(files):
    files.put(INPUTS, {"a": io.BytesIO(DATA)})
    with files.open_run("a", "b") as run:
        assert files.list_runs() == ["b"]
        assert run.source.read_bytes() == DATA
        run.target.write_bytes(b"result")
        run.target.with_name("beside").write_bytes(b"x")
        assert not files.exists(RESULTS, "b")
        assert run.publish() == (6, hashlib.sha256(b"result").hexdigest())
    assert read(files, RESULTS, "b") == b"result"
    assert files.list_runs() == []
    assert files.exists(INPUTS, "a")


def test_a_run_that_fails_leaves_nothing(files):
    files.put(INPUTS, {"a": io.BytesIO(DATA)})

    def fail():
        with files.open_run("a", "b") as run:
            run.target.write_bytes(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not files.exists(RESULTS, "b")
    assert files.list_runs() == []


def test_a_run_without_its_input(files):
    with pytest.raises(FileNotFoundError), files.open_run("a", "b"):
        pass
    assert files.list_runs() == []


def test_a_file_appears_once_it_is_complete(local_files, monkeypatch):
    seen = []
    copy = shutil.copyfileobj

    def copy_in_parts(file, out, length):
        out.write(file.read(100))
        seen.append(local_files.exists(INPUTS, "a"))
        copy(file, out, length)

    monkeypatch.setattr(shutil, "copyfileobj", copy_in_parts)
    local_files.put(INPUTS, {"a": io.BytesIO(DATA)})
    assert seen == [False]
    assert read(local_files, INPUTS, "a") == DATA


def test_the_hashes_in_memory_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "HASHES", 2)
    files = Files(str(tmp_path), tmp_path)
    for name in "abc":
        files.put(RESULTS, {name: io.BytesIO(DATA)})
        assert all(files.matches(RESULTS, name, len(DATA), hashlib.sha256(DATA).hexdigest()) for _ in range(2))
    assert files._hash.cache_info()[:] == (3, 3, 2, 2)  # each was read once, and two are kept


def test_an_error_of_an_object_stores_client_is_reported(tmp_path, monkeypatch, caplog):
    class ClientError(Exception):
        pass

    def fail(*args, **options):
        raise ClientError("could not connect")

    files = Files(f"memory://{tmp_path.name}/files", tmp_path / "scratch")
    monkeypatch.setattr(files._fs, "open", fail)
    with caplog.at_level(logging.WARNING), pytest.raises(QueueUnavailable, match="store doesn't answer"):
        files.put(INPUTS, {"a": io.BytesIO(DATA)})
    assert "could not connect" in caplog.text


def test_a_store_that_failed_is_tried_again(tmp_path, monkeypatch):
    files, calls = Files(f"memory://{tmp_path.name}/files", tmp_path / "scratch"), []
    files.check()
    with monkeypatch.context() as patch:

        def fail(*args, **options):
            calls.append(args)
            if len(calls) > 1:  # by `check`
                with pytest.raises(QueueUnavailable, match="store doesn't answer"):
                    files.check()  # for another request meanwhile: it isn't tried twice at once
            raise OSError("could not connect")

        patch.setattr(files._fs, "exists", fail)
        patch.setattr(files._fs, "open", fail)
        with pytest.raises(QueueUnavailable):
            files.exists(INPUTS, "a")
        for _ in range(2):
            with pytest.raises(QueueUnavailable, match="store doesn't answer"):
                files.check()
    files.check()
    assert len(calls) == 3
    assert files.list_names(INPUTS) == []


def test_a_store_whose_client_has_errors_of_its_own(tmp_path, monkeypatch):
    """As botocore's where there are no credentials."""

    class NoCredentialsError(Exception):
        pass

    def fail(*_, **__):
        raise NoCredentialsError("Unable to locate credentials")

    monkeypatch.setattr(MemoryFileSystem, "makedirs", fail)
    with pytest.raises(InvalidOption, match=r"^memory://a: .*\(Unable to locate credentials\); name another place"):
        Files("memory://a", tmp_path / "scratch")


def test_a_programming_error_is_not_reported_as_one_of_the_store(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise TypeError("an argument is missing")

    files = Files(f"memory://{tmp_path.name}/files", tmp_path / "scratch")
    monkeypatch.setattr(files._fs, "open", fail)
    with pytest.raises(TypeError):
        files.put(INPUTS, {"a": io.BytesIO(DATA)})
    monkeypatch.setattr(MemoryFileSystem, "makedirs", fail)
    with pytest.raises(TypeError):
        Files("memory://a", tmp_path / "scratch")


@pytest.mark.parametrize("place", ["nosuchscheme://bucket/path", "{tmp}/file/below", "data://bucket"])
def test_a_place_that_cannot_be_used(tmp_path, place):
    (tmp_path / "file").touch()
    with pytest.raises(InvalidOption, match="name another place"):
        Files(place.format(tmp=tmp_path), tmp_path / "scratch")


def test_a_place_that_cannot_be_written_is_refused_at_the_start(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise PermissionError("read only")

    monkeypatch.setattr(MemoryFileSystem, "_open", fail)
    with pytest.raises(InvalidOption, match=r"^memory://a: .*\(read only\); name another place"):
        Files("memory://a", tmp_path / "scratch")


def test_trying_a_place_leaves_nothing(files):
    assert (files.list_names(INPUTS), files.list_names(RESULTS)) == ([], [])
