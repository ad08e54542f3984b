import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType

import pytest

from ciir.errors import InputError, TooLarge, Unreadable, UnsupportedType
from ciir.renderer.limits import Limits
from ciir.renderer.readers.bundle import Archive, Bundle, Folder
from ciir.renderer.readers.picture_sizes import read_start
from tests.support.inputs import make_zip

OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def test_files_beside_and_below_a_file_are_found(tmp_path: Path) -> None:
    (tmp_path / "textures").mkdir()
    (tmp_path / "a.obj").write_bytes(OBJ)
    (tmp_path / "a b.mtl").write_bytes(b"newmtl x")
    (tmp_path / "textures" / "x.png").write_bytes(b"picture")
    bundle = Bundle.from_path(tmp_path / "a.obj")
    assert (bundle.name, bundle.main) == ("a.obj", "a.obj")
    assert bundle.files["a.obj"] == OBJ
    assert bundle.files["a b.mtl"] == b"newmtl x"
    assert bundle.files["textures/x.png"] == b"picture"
    assert "nothing.png" not in bundle.files


def test_the_start_of_a_file_is_read_alone(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(OBJ)
    (tmp_path / "a.zip").write_bytes(make_zip({"a.obj": OBJ, "b.obj": OBJ}))
    limits = Limits(bytes=2 * len(OBJ))
    for files in (Folder(tmp_path, limits), Archive(tmp_path / "a.zip", limits)):
        assert read_start(files, "a.obj", 3) == OBJ[:3]
        assert read_start(files, "a.obj", 1000) == OBJ
        with pytest.raises(KeyError):
            read_start(files, "../a.obj", 3)
    assert read_start({"a.obj": OBJ}, "a.obj", 3) == OBJ[:3]
    assert read_start(MappingProxyType({"a.obj": OBJ}), "a.obj", 3) is None


def test_files_outside_its_folder_are_not_found(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.mtl").write_bytes(b"secret")
    (inner / "a.obj").write_bytes(OBJ)
    files = Bundle.from_path(inner / "a.obj").files
    for name in ("../secret.mtl", str(tmp_path / "secret.mtl"), "x/../../secret.mtl", "", ".", "a\0"):
        assert name not in files
        with pytest.raises(KeyError):
            files[name]
    assert list(files) == ["a.obj"]


def test_a_link_that_was_named_itself_is_read(tmp_path: Path) -> None:
    (tmp_path / "links").mkdir()
    (tmp_path / "a.obj").write_bytes(OBJ)
    (tmp_path / "links" / "b.obj").symlink_to(tmp_path / "a.obj")
    assert Bundle.from_path(tmp_path / "links" / "b.obj").files["b.obj"] == OBJ


def test_links_to_files_and_folders_are_followed(tmp_path: Path) -> None:
    outside, inner = tmp_path / "outside", tmp_path / "inner"
    (outside / ".hidden").mkdir(parents=True)
    inner.mkdir()
    for name in ("a.png", ".hidden/b.png"):
        (outside / name).write_bytes(b"picture")
    (inner / "file.png").symlink_to(outside / "a.png")
    (inner / "folder").symlink_to(outside)
    (inner / "nothing.png").symlink_to(outside / "missing.png")
    (inner / "circle").symlink_to(inner)
    files = Bundle.from_path(inner).files
    assert list(files) == ["file.png", "folder/a.png"]
    assert files["file.png"] == files["folder/a.png"] == b"picture"
    assert "nothing.png" not in files


def test_a_link_to_many_folders_is_not_walked_through(tmp_path: Path) -> None:
    for number in range(4):
        (tmp_path / f"outside/{number}").mkdir(parents=True)
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner/link").symlink_to(tmp_path / "outside")
    with pytest.raises(TooLarge, match="inner: more than 3 folders"):
        list(Bundle.from_path(tmp_path / "inner", Limits(files=3)).files)


def test_a_folder_is_a_set_without_hidden_files(tmp_path: Path) -> None:
    for name in ("2.png", "1.png", ".DS_Store"):
        (tmp_path / name).write_bytes(b"x")
    bundle = Bundle.from_path(tmp_path)
    assert bundle.main is None
    assert list(bundle.files) == ["1.png", "2.png"]
    assert len(bundle.files) == 2


def test_a_folder_with_too_many_files(tmp_path: Path) -> None:
    for number in range(4):
        (tmp_path / f"{number}.png").write_bytes(b"x")
    bundle = Bundle.from_path(tmp_path, Limits(files=3))
    with pytest.raises(TooLarge, match="more than 3 files; give a folder that holds fewer"):
        list(bundle.files)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(Unreadable, match="No such file or directory; check the name and the folder"):
        Bundle.from_path(tmp_path / "a.obj")
    with pytest.raises(Unreadable):
        Bundle.from_path(Path("a\0.obj"))


def test_a_file_over_the_limit_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(OBJ)
    with pytest.raises(TooLarge, match=r"32 bytes; at most 10 are read; decimate"):
        Bundle.from_path(tmp_path / "a.obj", Limits(bytes=10))
    with pytest.raises(TooLarge, match=r"32 bytes; at most 10 are read; decimate"):
        Bundle.from_upload("a.obj", OBJ, Limits(bytes=10))


def test_a_clients_file_is_its_own_bytes_and_its_name_is_no_path(tmp_path: Path) -> None:
    (tmp_path / "secret.mtl").write_bytes(b"secret")
    bundle = Bundle.from_upload(str(tmp_path / "a.obj"), OBJ)
    assert (bundle.name, bundle.main, dict(bundle.files)) == ("a.obj", "a.obj", {"a.obj": OBJ})


@pytest.mark.parametrize("name", ["", "..", "C:", "x:y"])
def test_a_clients_file_with_a_name_that_is_none(name: str) -> None:
    bundle = Bundle.from_upload(name, OBJ)
    assert bundle.files[bundle.main] == OBJ


def test_a_zip_is_unpacked(tmp_path: Path) -> None:
    data = make_zip({"m/a.obj": OBJ, "m/x y.png": b"p", "__MACOSX/m/._a.obj": b"x", "m/.DS_Store": b"x"})
    (tmp_path / "a.zip").write_bytes(data)
    for bundle in (Bundle.from_upload("a.zip", data), Bundle.from_path(tmp_path / "a.zip")):
        assert bundle.main is None
        assert dict(bundle.files) == {"m/a.obj": OBJ, "m/x y.png": b"p"}


def test_a_zip_over_a_limit() -> None:
    with pytest.raises(TooLarge, match="unpacks to over 250 times its size"):
        Bundle.from_upload("a.zip", make_zip({"a.obj": bytes(2**21)}))
    data = make_zip({"a.obj": OBJ * 100, "b.obj": OBJ * 100})
    with pytest.raises(TooLarge, match="unpacks to 6,400 bytes; at most 6,000 are read; pack fewer or smaller"):
        Bundle.from_upload("a.zip", data, Limits(bytes=6000))
    with pytest.raises(TooLarge, match="2 files; at most 1 are read; pack fewer"):
        Bundle.from_upload("a.zip", data, Limits(files=1))


def test_the_limit_on_a_zip_on_the_disk_is_for_each_file(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    path.write_bytes(make_zip({"a.obj": OBJ * 100, "b.obj": OBJ * 100}))
    assert dict(Bundle.from_path(path, Limits(bytes=3200)).files) == {"a.obj": OBJ * 100, "b.obj": OBJ * 100}
    with pytest.raises(TooLarge, match=r"a\.zip: a\.obj: 3,200 bytes; at most 3,199 are read"):
        Bundle.from_path(path, Limits(bytes=3199))
    with pytest.raises(TooLarge, match="2 files; at most 1 are read"):
        Bundle.from_path(path, Limits(files=1))


def test_of_a_zip_on_the_disk_only_what_is_used_is_unpacked(tmp_path: Path) -> None:
    data = zip_members(("a.obj", OBJ), ("b.obj", b"v 1 2 3"), ("c.bin", make_zip({"a.obj": OBJ})))
    (tmp_path / "a.zip").write_bytes(data.replace(b"v 1 2 3", b"v 1 2 4"))  # its checksum is wrong
    files = Bundle.from_path(tmp_path / "a.zip").files
    assert files["a.obj"] == OBJ
    with pytest.raises(Unreadable, match="corrupt or truncated zip"):
        files["b.obj"]
    with pytest.raises(UnsupportedType, match=r"holds another zip, c\.bin"):
        files["c.bin"]
    with pytest.raises(KeyError):
        files["d.obj"]


def test_a_zip_that_lies_about_its_sizes() -> None:
    data = make_zip({"a.obj": OBJ * 100})
    claimed = (3200).to_bytes(4, "little")
    assert data.count(claimed) == 2
    with pytest.raises(Unreadable, match="corrupt"):
        Bundle.from_upload("a.zip", data.replace(claimed, (10).to_bytes(4, "little")))


def zip_members(*members: tuple[str, bytes], mode: int = 0, **options: int) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", **options) as archive:
        for name, data in members:
            info = zipfile.ZipInfo(name)
            info.external_attr, info.compress_type = mode << 16, archive.compression
            archive.writestr(info, data)
    return out.getvalue()


def encrypted() -> bytes:
    data = bytearray(make_zip({"a.obj": OBJ}))
    data[6] |= 1  # the flags in the local header, and in the central directory
    data[data.index(b"PK\1\2") + 8] |= 1
    return bytes(data)


def test_names_with_backslashes_are_taken_as_unzip_takes_them(tmp_path: Path) -> None:
    data = make_zip({"m\\": b"", "m\\a.obj": OBJ, "m\\t\\x.png": b"x", "m\\.hidden": b""})
    (tmp_path / "a.zip").write_bytes(data)
    for bundle in (Bundle.from_upload("a.zip", data), Bundle.from_path(tmp_path / "a.zip")):
        assert dict(bundle.files) == {"m/a.obj": OBJ, "m/t/x.png": b"x"}


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        *(
            (lambda name=name: make_zip({name: OBJ}), Unreadable, "leads out of the zip")
            for name in (
                "../a.obj",
                "/a.obj",
                "m/../../a.obj",
                "C:/a.obj",
                "C:\\a.obj",
                "m\\..\\..\\a.obj",
                "..\\a.obj",
            )
        ),
        (lambda: zip_members(("a.obj", b"/etc/passwd"), mode=stat.S_IFLNK | 0o777), UnsupportedType, "is a link"),
        (encrypted, Unreadable, "encrypted; pack it without a password"),
        (lambda: make_zip({"b.zip": make_zip({"a.obj": OBJ})}), UnsupportedType, "holds another zip"),
        (lambda: zip_members(("a.obj", OBJ), compression=zipfile.ZIP_LZMA), UnsupportedType, "plain deflate"),
        (lambda: zip_members(("a.obj", OBJ), ("a.obj", b"v 9 9 9")), Unreadable, "twice"),
        (lambda: zip_members(("m/a.obj", OBJ), ("m\\a.obj", b"v 9 9 9")), Unreadable, "twice"),
    ],
)
def test_zips_that_are_refused(
    make: Callable[[], bytes], error: type[InputError], message: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=message):
        Bundle.from_upload("a.zip", make())
    (tmp_path / "a.zip").write_bytes(make())
    with pytest.raises(error, match=message):
        dict(Bundle.from_path(tmp_path / "a.zip").files)


def test_a_zip_with_any_one_byte_wrong_or_cut_anywhere_is_read_or_refused() -> None:
    data = make_zip({"a.obj": OBJ, "x.mtl": b"newmtl x"})
    damaged = [data[:end] for end in range(4, len(data))]
    damaged += [data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :] for at in range(4, len(data))]
    messages = []
    for broken in damaged:
        try:
            Bundle.from_upload("a.zip", broken)
        except (Unreadable, UnsupportedType, TooLarge) as error:
            messages.append(str(error))
    assert len(messages) > len(damaged) / 2
    assert not any("\n" in message for message in messages)
