"""Errors a user can cause and mend."""


class InputError(Exception):
    """Bad input from a user.

    The message is one sentence that names the thing (file, column, row, key, option) and where it came from. The
    command line prints it as one line and exits with status 2; a traceback would mean a bug of ours.
    """
