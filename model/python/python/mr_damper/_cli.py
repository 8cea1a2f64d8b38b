"""The command ``mr-damper``."""

import os
import signal
import sys


def main() -> None:
    """Run the command line of this process, and end the process with the exit code of the command."""
    from mr_damper import _native

    # Python's handler only notes the signal and never runs while the command does. With the default action restored, the command's own
    # handlers act as in the program without Python.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    code = _native.main(sys.argv[1:])
    sys.stdout.flush()
    sys.stderr.flush()
    # As a program does that returns from `main`: threads of the middlewares may still run, and Python would wait for none of them.
    os._exit(code)


if __name__ == "__main__":
    main()
