"""Files that are there whole or not at all."""

import os
import secrets
from pathlib import Path


def check_can_be_written(path: str | os.PathLike[str]) -> Path:
    """The file behind `path` (through a symbolic link), or the reason why it could not be written; for asking before work.

    Raises:
        FileNotFoundError: there is no such folder.
        IsADirectoryError: the path is a folder.
        PermissionError: the folder may not be written to.
    """
    target = Path(path).resolve()
    if not target.parent.is_dir():
        raise FileNotFoundError(
            f"cannot write {path}: the folder {target.parent} does not exist; create it first"
        )
    if target.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a folder, not a file")
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(f"cannot write {path}: no permission to write in {target.parent}")
    return target


def write_whole(path: str | os.PathLike[str], content: bytes) -> None:
    """Puts `content` in place in one step: readers see the old file or the new one, never a part.

    Raises:
        OSError: the file cannot be written; nothing is left behind and an existing file stays as it was.
    """
    target = check_can_be_written(path)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as stream:
            stream.write(content)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
