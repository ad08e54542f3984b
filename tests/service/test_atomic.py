import pytest

from renderer.errors import InvalidOption
from service.atomic import Staged, replacing


def test_a_file_appears_whole(tmp_path):
    target = tmp_path / "new" / "a.bin"
    with replacing(target) as file:
        file.write(b"whole")
        assert not target.exists()
    assert target.read_bytes() == b"whole"
    assert list(target.parent.iterdir()) == [target]


def test_a_fault_leaves_the_old_file(tmp_path):
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


def test_a_folder_appears_whole(tmp_path):
    staged = Staged(tmp_path / "out")
    staged.write("a", b"1")
    assert not (tmp_path / "out").exists()
    staged.commit()
    staged.discard()
    assert (tmp_path / "out" / "a").read_bytes() == b"1"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_own_names_are_replaced_and_others_stay(tmp_path):
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "mine").write_bytes(b"mine")
    staged = Staged(tmp_path)
    staged.write("a", b"new")
    staged.commit()
    staged.discard()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"new", "mine": b"mine"}


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
