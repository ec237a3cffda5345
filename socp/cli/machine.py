"""What the machine may lack, a disk or memory: found out before where that is possible, told as
what it is else.
"""

from socp.errors import KeepingError

_LEAST = (
    512 * 2**20
)  # bytes of addresses: with less, the linear algebra of the solvers waits for memory for ever
_UNLIMITED = -1


def roomy() -> None:
    """Raise KeepingError where a limit of the address space leaves no room for the solvers."""
    try:
        import resource
    except ImportError:  # no such limits here
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != _UNLIMITED and limit < _LEAST:
        raise KeepingError(
            f"memory: the address space is limited to {limit // 2**20} MiB, and the solvers need "
            f"{_LEAST // 2**20} MiB at least; raise the limit: ulimit -v {_LEAST // 2**10}, or "
            "more"
        )


def lacking(error: BaseException) -> str:
    """Return what an error says that the machine lacks; empty where it says something else."""
    if isinstance(error, MemoryError) or "bad_alloc" in str(error):
        return "the memory gave out; give it more, or solve on a coarser grid"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}"
    return ""
