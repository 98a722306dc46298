"""The `dsbrdf` command: parse, call, print.

What fails is told in one line on standard error, `dsbrdf: error: ...`, with exit status 1, or 2 for a command
that cannot be understood. Numeric modules are imported where they are used, so that help comes at once.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import socket
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer

from dsbrdf import _text

__all__ = [
    "Force",
    "State",
    "app",
    "check_folder",
    "check_output",
    "is_quiet",
    "is_verbose",
    "main",
    "missing_plots",
    "note",
    "say",
    "standard_input",
    "tell",
    "trace",
]

INTERRUPTED = 130
#: Seconds after Ctrl-C in which the work may end by itself.
PATIENCE = 0.5

#: What all commands that write a file which the user names have.
Force = Annotated[bool, typer.Option("--force", help="Replace files that dsbrdf did not write.")]

app = typer.Typer(
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


#: Of the whole process, as threads note and warn, too.
_quiet, _verbose = threading.Event(), threading.Event()
#: Options that hold wherever they stand.
QUIET, VERBOSE, DEBUG = {"--quiet", "-q"}, {"--verbose", "-v"}, {"--debug"}
#: What stands for standard input where a file is read, and the most that is taken from it.
STANDARD_INPUT, MAX_INPUT = "-", 1 << 28
#: Files of ours that messages call by another name.
_called: dict[str, str] = {}


@dataclass
class State:
    """What all commands share: what to show, what is being worked on, for warnings, and what has failed.

    Parameters
    ----------
    debug : bool
        Whether to show tracebacks.
    failed : bool
        Whether something was passed over.
    """

    debug: bool = False
    failed: bool = False
    # Threads work on different files
    work: threading.local = field(default_factory=threading.local)

    def begin(self, about: str) -> None:
        """Note what this thread is working on."""
        self.work.about = about
        if about:
            trace(about)

    def announce(self, step: Callable[[str], None]) -> Callable[[str], None]:
        """`step`, and a note of what is being worked on."""

        def both(about: str) -> None:
            self.work.about = about
            step(about)

        return both

    @contextlib.contextmanager
    def passing_over(self, target: str, targets: Sequence[str]) -> Iterator[None]:
        """Say what is wrong with one of several targets, and go on; the exit status tells of it in the end."""
        try:
            yield
        except (OSError, ValueError) as error:
            if self.debug or len(targets) == 1:
                raise
            from dsbrdf import batch

            text = batch.describe(error)
            say(f"error: {text if target in text else f'{target}: {text}'}")
            self.failed = True

    def end(self) -> None:
        """Leave with status 1 if something was passed over."""
        if self.failed:
            raise typer.Exit(1)

    def show_warning(
        self, message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
    ) -> None:
        about = getattr(self.work, "about", "")
        named = not about or str(message).startswith(f"{Path(about).stem}: ")
        note(f"warning: {message}" if named else f"warning: {about}: {message}")
        trace(f"{category.__name__}, {filename}:{lineno}")


def say(text: str) -> None:
    """One line to standard error."""
    print("dsbrdf:", _text.shown(" ".join(called(text).split("\n"))), file=sys.stderr)


def tell(text: object, *, error: bool = False) -> None:
    """A line or more to standard output, or to standard error; what would drive a terminal is shown instead."""
    shown = _text.shown(called(str(text)), keep="\n")
    print(shown, file=sys.stderr if error else sys.stdout, flush=True)


def note(text: str) -> None:
    """One line to standard error that is no error; none if the user wants quiet."""
    if not is_quiet():
        say(text)


def trace(text: str) -> None:
    """One line to standard error, with the time since the start, if the user wants to know all."""
    if is_verbose():
        say(f"{time.perf_counter() - _start:.2f} s: {text}")


def is_quiet() -> bool:
    """Whether progress, notes and warnings are left out."""
    return _quiet.is_set()


def is_verbose() -> bool:
    """Whether steps and their times, versions and the places of warnings are shown."""
    return _verbose.is_set()


_start = time.perf_counter()


def called(text: str) -> str:
    """A text in which files of ours have the names that the user knows."""
    for path, name in _called.items():
        text = text.replace(path, name)
    return text


@contextlib.contextmanager
def standard_input() -> Iterator[Path]:
    """A file of what is piped in, which is text.

    Raises
    ------
    ValueError
        If nothing is piped in, or what is not text, or more than `MAX_INPUT` bytes.
    """
    from dsbrdf.measured.formats.text_file import is_text

    if sys.stdin.isatty():
        raise ValueError("standard input: nothing is piped in. Give a file, or pipe text into '-'.")
    with tempfile.TemporaryDirectory(prefix="dsbrdf-") as folder:
        path = Path(folder, "stdin")
        stream = sys.stdin.buffer
        head = stream.read(4096)
        if head and not is_text(head):
            raise ValueError(
                "standard input: expected text with columns, got a binary file that begins with "
                f"{head[:12]!r}. Give its name instead of '-'."
            )
        with path.open("wb") as file:
            file.write(head)
            while block := stream.read(1 << 20):
                if file.tell() + len(block) > MAX_INPUT:
                    raise ValueError(
                        f"standard input: more than {MAX_INPUT:,} bytes. Write it to a file, and give its name."
                    )
                file.write(block)
        _called[str(path)] = "standard input"
        try:
            yield path
        finally:
            del _called[str(path)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process by default.
    """
    # Before NumPy is imported. Matrices are small: threads that wait for each other cost more than they do
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if "_DSBRDF_COMPLETE" in os.environ:
        app(prog_name="dsbrdf")
    # Wherever they stand, these hold
    given = set(arguments)
    state = State(debug=bool(DEBUG & given))
    for event, options in ((_quiet, QUIET), (_verbose, VERBOSE)):
        event.set() if options & given else event.clear()
    arguments = [each for each in arguments if each not in QUIET | VERBOSE | DEBUG] or ["--help"]
    if is_verbose():
        _trace_versions()
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("always", UserWarning)
        warnings.showwarning = state.show_warning
        try:
            with _ending_soon():
                status = _invoke(arguments, state)
            sys.stdout.flush()
        except BrokenPipeError:
            _discard_output()
            return 1
        except (KeyboardInterrupt, Exception) as error:
            if state.debug:
                raise
            _discard_output()
            return _report(error)
    trace(f"end, {time.process_time():.2f} s of processor time")
    return status


def _trace_versions() -> None:
    import platform
    from importlib import metadata

    from dsbrdf._core import build_info

    packages = [f"{name} {metadata.version(name)}" for name in ("dsbrdf", "numpy", "scipy")]
    python = f"Python {platform.python_version()}"
    trace(f"{', '.join([*packages, python])}, {platform.platform()}, {os.cpu_count()} cores")
    trace("kernel: {target}, {profile}, {compiler}; {vectors}, {threads} threads".format(**build_info()))


def _invoke(arguments: list[str], state: State) -> int:
    command = typer.main.get_command(app)
    try:
        with command.make_context("dsbrdf", arguments, obj=state) as context:
            command.invoke(context)
    except typer.Exit as end:
        return int(end.exit_code)
    return 0


@contextlib.contextmanager
def _ending_soon() -> Iterator[None]:
    """End the process soon after Ctrl-C: Python itself learns of it only when the compiled kernel comes back."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    ended = threading.Event()

    def wait() -> None:
        with reader:
            while number := reader.recv(1):
                if number[0] == signal.SIGINT and not ended.wait(PATIENCE):
                    _leave()

    previous = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=wait, daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        signal.set_wakeup_fd(previous)
        writer.close()


def _leave() -> None:
    """End the process and its workers, whatever they do."""
    import multiprocessing

    for process in multiprocessing.active_children():
        process.kill()
    if sys.stderr.isatty():
        # A bar of progress has hidden the cursor
        sys.stderr.write("\x1b[?25h\r\x1b[K")
    say("interrupted")
    sys.stderr.flush()
    os._exit(INTERRUPTED)


def _report(error: BaseException) -> int:
    """Tell of an error in one line, and return the exit status."""
    if isinstance(error, KeyboardInterrupt):
        say("interrupted")
        return INTERRUPTED
    usage = getattr(error, "format_message", None)
    if usage is not None:
        context = getattr(error, "ctx", None)
        text = usage().replace("Value error, ", "").rstrip(".")
        say(f"error: {text}. Try '{context.command_path if context else 'dsbrdf'} --help'.")
        return int(getattr(error, "exit_code", 2))
    from dsbrdf import batch

    say(f"error: {batch.describe(error)}")
    return 1


def _discard_output() -> None:
    """Send what is left in the buffer of a broken standard output nowhere, so that Python ends quietly."""
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(OSError), open(os.devnull, "w") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _version(wanted: bool) -> None:
    if wanted:
        from dsbrdf import __version__

        print(f"dsbrdf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    _wanted: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    _quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="No progress, notes and warnings; errors are shown.")
    ] = False,
    _verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", "-v", help="Steps and their times, versions, and where warnings come from."
        ),
    ] = False,
    _debug: Annotated[bool, typer.Option("--debug", help="Show a traceback where something fails.")] = False,
) -> None:
    """Directional statistics BRDF model: measured reflectance to a few lobes, and back."""
    context.ensure_object(State)


def check_folder(folder: Path) -> None:
    """Fail before the work is done if `folder` is none, or cannot be made or written to."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(existing))
    if not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(existing))


def check_output(out: Path, inputs: Iterable[str | Path], *, force: bool = False) -> None:
    """Fail before the work is done if `out` may not be replaced: see `dsbrdf._files.check_replaceable`."""
    from dsbrdf import _files

    try:
        _files.check_replaceable(out, force=force, sources=inputs)
    except FileExistsError as error:
        raise typer.BadParameter(str(error), param_hint="'--out'") from None


def missing_plots() -> str:
    """Why there can be no plots, empty if there can."""
    try:
        from dsbrdf import plot  # noqa: F401
    except ModuleNotFoundError as error:
        return str(error)
    return ""
