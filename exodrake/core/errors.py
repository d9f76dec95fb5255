"""Errors a user can cause and mend."""


class InputError(Exception):
    """Bad input from a user.

    The message is one sentence that names the thing (file, column, row, key, option) and where it came from. The
    command line prints it as one line and exits with status 2; a traceback would mean a bug of ours.
    """


def nearest(word: str, words: list[str]) -> str:
    """A hint at names that resemble `word`."""
    import difflib

    close = difflib.get_close_matches(word, words, 3, 0.5)
    return f"; did you mean {' or '.join(close)}?" if close else ""
