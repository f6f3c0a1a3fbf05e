"""slow.txt is sorted, names each test once, and only tests that there are."""

from __future__ import annotations

from conftest import HERE, listed


def test_the_list_is_sorted_and_has_nothing_twice() -> None:
    assert len(listed()) > 100
    assert listed() == sorted(set(listed()))


def test_the_list_names_tests_that_there_are(gone: list[str]) -> None:
    assert gone == []


def test_the_list_names_files_that_there_are() -> None:
    files = {name.split("::")[0] for name in listed()}
    assert all((HERE.parent / name).is_file() for name in files)
