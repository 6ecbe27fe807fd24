"""The number of cores of a process: those of its affinity, within a quota."""

import os

import pytest

import arm_drake as ad
from arm_drake.batch import api
from arm_drake.batch import api as cores
from tests.batch.functions import square


@pytest.mark.parametrize(
    ("files", "quota"),
    [
        ({"cpu.max": "max 100000\n"}, None),
        ({"cpu.max": "250000 100000\n"}, 2.5),
        ({"cpu.max": "50000 100000\n"}, 0.5),
        ({"cpu.cfs_quota_us": "-1\n", "cpu.cfs_period_us": "100000\n"}, None),
        ({"cpu.cfs_quota_us": "300000\n", "cpu.cfs_period_us": "100000\n"}, 3.0),
        ({}, None),
    ],
)
def test_a_quota_is_read(tmp_path, files, quota) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text)

    assert cores.read_quota(tmp_path, tmp_path) == quota


@pytest.mark.parametrize(
    ("affinity", "quota", "expected"),
    [(8, None, 8), (8, 2.5, 3), (8, 0.5, 1), (2, 16.0, 2)],
)
def test_the_lesser_counts(monkeypatch, affinity, quota, expected) -> None:
    monkeypatch.setattr(
        os, "sched_getaffinity", lambda pid: set(range(affinity)), raising=False
    )
    monkeypatch.setattr(cores, "read_quota", lambda: quota)

    assert cores.available_cores() == expected


def test_as_many_runs_are_executed_at_a_time(monkeypatch) -> None:
    monkeypatch.setattr(api, "available_cores", lambda: 3)

    assert ad.run_many(range(9), square, backend="threads").workers == 3
    assert ad.run_many(range(2), square, backend="threads").workers == 2
    assert ad.run_many(range(9), square, backend="threads", workers=5).workers == 5
