"""Cores that a process may use, within the quota of its control groups."""

import math
import os

import pytest

from ciir import cores


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """The file system of control groups; this process is in the group `/a/b` of both versions."""
    membership = tmp_path / "cgroup"
    membership.write_text("1:cpu:/a/b\n0::/a/b\n")
    monkeypatch.setattr(cores, "GROUPS", tmp_path / "groups")
    monkeypatch.setattr(cores, "MEMBERSHIP", membership)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    cores.read_quota.cache_clear()
    yield tmp_path / "groups"
    cores.read_quota.cache_clear()


def write_group(folder, **files):
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("cpu_", "cpu.")).write_text(text + "\n")


@pytest.mark.parametrize(
    ("folder", "files", "expected"),
    [
        ("", {"cpu_max": "150000 100000"}, 2),  # rounded up; a container's own group is the root
        ("a/b", {"cpu_max": "50000 100000"}, 1),
        ("a", {"cpu_max": "300000 100000"}, 3),  # a group limits those in it
        ("a/b", {"cpu_max": "max 100000"}, 8),
        ("c", {"cpu_max": "100000 100000"}, 8),  # another group
        ("unified/a", {"cpu_max": "300000 100000"}, 3),
        ("cpu/a/b", {"cpu_cfs_quota_us": "400000", "cpu_cfs_period_us": "100000"}, 4),
        ("cpu", {"cpu_cfs_quota_us": "-1", "cpu_cfs_period_us": "100000"}, 8),
        ("", {"cpu_max": "3200000 100000"}, 8),  # more than the affinity allows
    ],
)
def test_quotas_limit_the_cores(groups, folder, files, expected):
    write_group(groups / folder, **files)
    assert cores.count_available_cores() == expected


def test_without_control_groups_there_is_no_quota(groups, monkeypatch):
    monkeypatch.setattr(cores, "MEMBERSHIP", groups / "absent")
    assert cores.read_quota() == math.inf
    assert cores.count_available_cores() == 8
