"""The one exception for a user's mistake."""


class InputError(ValueError):
    """The user's input is wrong: the message names the file or option, the value and the remedy.

    The command line prints the message alone, without a traceback, and exits with 2.
    """
