import os

import pytest

from ciir.errors import InvalidOption
from ciir.renderer.writers.atomic_write import Staged, place_for_file, replacing


def test_a_file_appears_whole(tmp_path):
    target = tmp_path / "new" / "a.bin"
    with replacing(target) as file:
        file.write(b"whole")
        assert not target.exists()
    assert target.read_bytes() == b"whole"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("letter", "aä")
def test_the_longest_names_are_written(tmp_path, letter):
    """File systems allow 255 bytes."""
    name = letter * (254 // len(letter.encode()))
    with replacing(tmp_path / f"{name}1") as file:
        file.write(b"whole")
    staged = Staged(tmp_path / f"{name}2")
    staged.commit()
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}1", f"{name}2"}


def test_an_error_leaves_the_old_file(tmp_path):
    target = tmp_path / "a.bin"
    target.write_bytes(b"old")
    with pytest.raises(TypeError), replacing(target) as file:
        file.writelines([b"ha", "text"])
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_in_the_way(tmp_path):
    with pytest.raises(InvalidOption, match="folder"), replacing(tmp_path):
        pass


def test_a_file_where_a_folder_must_be(tmp_path):
    (tmp_path / "a").write_bytes(b"")
    with pytest.raises(InvalidOption, match="not a folder"), replacing(tmp_path / "a" / "b"):
        pass
    with pytest.raises(InvalidOption, match="a file is there"):
        Staged(tmp_path / "a")


def test_a_device_or_a_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InvalidOption, match="pipe: not a regular file"), replacing(tmp_path / "pipe"):
        pass
    assert (tmp_path / "pipe").is_fifo()


def test_where_nothing_may_be_written(tmp_path, monkeypatch):
    monkeypatch.setattr("ciir.renderer.writers.atomic_write.os.access", lambda path, mode: path != tmp_path)
    for make in (place_for_file, Staged):
        with pytest.raises(InvalidOption, match="no permission to write there"):
            make(tmp_path / "new" / "a")
    assert list(tmp_path.iterdir()) == []


def test_a_file_goes_where_a_link_leads(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "a").write_bytes(b"old")
    (tmp_path / "link").symlink_to(tmp_path / "far" / "a")
    with replacing(tmp_path / "link") as file:
        file.write(b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "far" / "a").read_bytes() == b"new"


def test_a_folder_that_is_there_is_filled_from_within(tmp_path):
    """It may be the root of a file system, into which nothing can be moved from beside it."""
    staged = Staged(tmp_path)
    assert staged.temporary.parent == tmp_path
    staged.discard()
    assert list(tmp_path.iterdir()) == []


def test_what_is_to_go_goes_unless_it_is_new(tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / name).write_bytes(b"old")
    staged = Staged(tmp_path)
    staged.write("a", b"new")
    staged.commit(remove=["a", "b", "gone"])
    staged.discard()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"new", "c": b"old"}


def test_a_folder_appears_whole(tmp_path):
    staged = Staged(tmp_path / "out")
    staged.write("a", b"1")
    assert not (tmp_path / "out").exists()
    staged.commit()
    staged.discard()
    assert (tmp_path / "out" / "a").read_bytes() == b"1"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_nothing_is_replaced_where_one_can_not_be(tmp_path):
    out = tmp_path / "out"
    (out / "b").mkdir(parents=True)
    (out / "a").write_bytes(b"old")
    staged = Staged(out)
    staged.write("a", b"new")
    staged.write("b", b"new")
    with pytest.raises(InvalidOption, match="folder"):
        staged.commit()
    staged.discard()
    assert (out / "a").read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
