"""The cache of generated code: damaged files are written anew, a folder that cannot be written is done without."""

import pytest

from exodrake.compiled import cache


@pytest.fixture(autouse=True)
def forget(monkeypatch):
    monkeypatch.setattr(cache, "_loaded", {})
    cache.temporary_folder.cache_clear()


def test_a_damaged_file_is_written_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("EXODRAKE_CACHE", str(tmp_path))
    assert cache.load_text("trial", "answer = 41\n").answer == 41
    (file,) = tmp_path.glob("trial_*.py")
    file.write_bytes(b"answer = \xff")
    monkeypatch.setattr(cache, "_loaded", {})
    assert cache.load_text("trial", "answer = 41\n").answer == 41
    assert file.read_text() == "answer = 41\n"


def test_a_folder_that_cannot_be_written_costs_one_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("EXODRAKE_CACHE", str(tmp_path / "file"))
    assert cache.load_text("trial", "answer = 42\n").answer == 42
    assert cache.load_text("trial", "answer = 43\n").answer == 43
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and "cache cannot be used" in said
