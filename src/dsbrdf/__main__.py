"""`python -m dsbrdf`, and the command `dsbrdf`."""

import os
import sys

__all__ = ["run"]


def run() -> int:
    """Run the command line and return its exit status; an interruption ends it in a line, in imports too."""
    try:
        _open_streams()
        from dsbrdf.cli import main

        return main()
    except KeyboardInterrupt:
        print("dsbrdf: interrupted", file=sys.stderr)
        return 130


def _open_streams() -> None:
    """Give closed standard streams somewhere to go; the next file that is opened would take their place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            # Closed at the end of the process
            setattr(sys, name, open(os.devnull, "w" if number else "r"))  # noqa: PTH123, SIM115
    for stream in (sys.stdout, sys.stderr):
        # A name that the locale has no letters for is no reason to fail
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


if __name__ == "__main__":
    sys.exit(run())
