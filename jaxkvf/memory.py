"""Whether something fits into memory, asked before it is begun."""

from pathlib import Path

_PROCESS_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current")


def available_memory() -> int | None:
    """Bytes that can be had without swapping, within the container's limit if there is one; None where unknown."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        available = next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError, IndexError):
        return None
    try:
        limit, used = (int(Path(file).read_text(encoding="ascii")) for file in _PROCESS_LIMITS)
    except (OSError, ValueError):  # no container, or one without a limit ("max")
        return available
    return min(available, max(limit - used, 0))


def shortage(needed: int, purpose: str) -> str | None:
    """What to say if `needed` bytes cannot be had for `purpose`; None if they can, or nobody knows."""
    available = available_memory()
    if available is None or needed <= available:
        return None
    return (
        f"{purpose} takes about {needed / 2**30:.1f} GiB of memory, {available / 2**30:.1f} GiB are available"
    )
