"""Work in a process of its own that is killed, or out of disk, at the k-th change of a file below a folder."""

import errno
import os
import signal
import sys
import traceback

CHANGING = ("os.rename", "os.mkdir", "os.remove", "os.rmdir")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
ENDED, TOLD, BUG = 0, 2, 1


def fails(work, root, at, fault="kill"):
    """How it ends: -SIGKILL, ENDED before the k-th change, TOLD by an InputError, or BUG."""
    child = os.fork()
    if child == 0:
        os._exit(_work(work, os.path.abspath(root), at, fault))
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def every_moment(work, root, fault="kill", step=1):
    """Yields after each fault, at the first change of a file, the second and so on, until the work comes to its end."""
    for at in range(1, 1000, step):
        ended = fails(work, root, at, fault)
        if ended == ENDED:
            assert at > 3, "nothing was counted"
            return
        yield ended


def _work(work, root, at, fault):
    """In the new process."""
    from passerby.common.errors import InputError

    count = 0

    def happens(freeing=False):
        nonlocal count
        count += 1
        if fault == "kill" and count == at:
            os.kill(os.getpid(), signal.SIGKILL)
        if fault == "full" and count >= at and not freeing:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def audit(event, arguments):
        if event != "open" and event not in CHANGING:
            return
        path = arguments[0]
        if not isinstance(path, str | os.PathLike) or not os.path.abspath(path).startswith(root):
            return
        if event != "open" or (isinstance(arguments[2], int) and arguments[2] & WRITING):
            happens(event in ("os.remove", "os.rmdir"))

    fsync = os.fsync
    os.fsync = lambda handle: (happens(), fsync(handle))[1]
    sys.addaudithook(audit)
    try:
        work()
    except InputError:
        return TOLD
    except BaseException:
        traceback.print_exc()
        return BUG
    return ENDED


def visible(folder):
    """The files that somebody reads, by name."""
    found = {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: content for name, content in found.items() if not any(part[0] == "." for part in name.split("/"))}


def hidden(folder):
    """What was left behind."""
    return sorted(path.name for path in folder.rglob(".*"))
