"""The errors that socp raises on purpose; anything else is a bug."""


class SocpError(Exception):
    """Base of every error that socp raises on purpose; its text is written for the user."""


class ProblemError(SocpError):
    """A problem is not well posed as written, or could not be loaded."""


class MethodError(SocpError):
    """A method, an option or a plugin was asked for something it does not offer."""


class SolveError(SocpError):
    """A solve could not be carried out, or a result could not be read or judged."""


class ContractError(SocpError):
    """A method broke the contract of methods: it raised, returned or told what none may; the text names it."""


class KeepingError(SocpError):
    """The machine gave out: a disk or the memory. The text says what is kept, and where."""
