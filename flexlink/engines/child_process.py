"""Run functions and complete engines in a child process, whose crash or hang raises an error in this process.

The child is a new Python interpreter. It does not copy this process and does not run the main script again. On every
system, calls go to its standard input, results come from its standard output, and printed text goes to a temporary
file. The child is killed if its `ChildProcess` is deleted or a call takes too long. It also ends when this process
ends for any reason, because its standard input is then closed. A child that is no longer used is reused by the next
engine of the same name, because starting and importing takes a second or two.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from threading import Thread, Timer
from typing import IO, Any

from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, EngineError, FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.engines.base import Delegate, Engine, ForeignFile, OtherProgram, Samples, evaluated

CALL_TIMEOUT = 300.0
"""Time limit of a call [s]. A call takes milliseconds, but a first run may have to compile flexlink's kernels."""
TIMEOUT_PER_STEP = 0.01  # extra time per step of a run [s]
HEAD = 8  # number of bytes that encode the length of a call


class ChildProcess:
    """A child process that runs one function after another; `process` has its process id and exit code."""

    def __init__(self) -> None:
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  closed with the child
        command = "from flexlink.engines.child_process import _serve; _serve()"
        paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", command], env=os.environ | {"PYTHONPATH": paths},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._output,
        )  # fmt: skip
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._calls, self._results = self.process.stdin, self.process.stdout
        self._seen = 0  # number of bytes that earlier calls have printed
        self._late = False  # whether the child was killed because a call took too long
        self._kill = weakref.finalize(self, _kill, self.process, self._output)

    def call(self, what: str, seconds: float, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        """Run a function, which the child imports by name, with a time limit [s]; 0: none.

        `what` describes the call for messages. Arguments and result are pickled.
        """
        if self._calls.closed:
            raise self._failure(what, seconds)
        try:
            call = pickle.dumps((what, function, arguments, named))
            with self._limited(seconds):
                self._calls.write(len(call).to_bytes(HEAD, "little") + call)
                self._calls.flush()
                result = pickle.load(self._results)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise self._failure(what, seconds) from None
        except BaseException:  # Ctrl-C: the result is no longer needed
            self._kill()
            raise
        if isinstance(result, Exception):
            raise result
        return result

    @contextlib.contextmanager
    def _limited(self, seconds: float) -> Iterator[None]:
        """Kill the child if the `with` block takes longer than `seconds`; 0: no limit."""
        timer = Timer(seconds, self._end_late)
        timer.daemon = True
        if seconds:
            timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _end_late(self) -> None:
        self._late = True
        self.process.kill()

    @property
    def alive(self) -> bool:
        """Whether the child can be called."""
        return self.process.poll() is None

    def forget_output(self) -> None:
        """Make `output` start with lines printed after this call."""
        self._seen = os.fstat(self._output.fileno()).st_size

    def output(self) -> list[str]:
        """Return the lines that the child has printed so far to stdout and stderr."""
        if self._output.closed:
            return []
        self._output.seek(self._seen)
        return [line.strip() for line in self._output.read().decode(errors="replace").split("\n")]

    def _failure(self, what: str, seconds: float) -> BaseException:
        """Return the error that explains why there is no result."""
        code = self.process.wait()
        if code == -signal.SIGINT:
            return KeyboardInterrupt()  # a terminal sends the signal to both processes
        if self._late:
            why = f"{what}: no result within {seconds:g} s; the child process was killed"
            return EngineError(why, id="engine-timeout")
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        last = next((line for line in reversed(self.output()) if line), "none")
        return EngineError(f"{what}: the child process {how}; last line of its output: {last}", id="engine-crashed")


def _kill(process: subprocess.Popen[bytes], output: IO[bytes]) -> None:
    process.kill()
    process.wait()
    for file in (process.stdin, process.stdout, output):
        if file is not None:
            with contextlib.suppress(OSError):  # stdin may hold a call that the child has not read
                file.close()


def _serve() -> None:
    """Main loop of the child: run the calls of the parent."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends the child at once, even inside compiled code
    results = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # redirect printed text to stderr
    calls = SimpleQueue[bytes]()
    Thread(target=_listen, args=(sys.stdin.buffer, calls), daemon=True).start()
    while True:
        what, function, arguments, named = pickle.loads(calls.get())
        try:
            result = function(*arguments, **named)
        except FlexlinkError as error:
            result = error
        except Exception as error:
            result = EngineError(f"{what}: {type(error).__name__}: {' '.join(str(error).split())}", id="engine-failed")
        pickle.dump(result, results)
        results.flush()


def _listen(stdin: IO[bytes], calls: SimpleQueue[bytes]) -> None:
    """Queue every call when it arrives, even during another call; end the child after the parent has ended."""
    while head := stdin.read(HEAD):
        calls.put(stdin.read(int.from_bytes(head, "little")))
    os._exit(1)


class IsolatedEngine(Delegate):
    """Engine `name` with a chain or a file; implements `Engine` and runs every method in a child process."""

    def __init__(self, name: str, source: Chain | ForeignFile) -> None:
        self.name, self._source = name, source.name if isinstance(source, Chain) else str(source.path)
        child = _idle.pop((name, os.getpid()), None)
        self._child = child if child is not None and child.alive else ChildProcess()
        self._child.forget_output()
        weakref.finalize(self, _keep, name, self._child)
        try:
            self.version, self.n = self._call("load", _load, name, source)
        except ArgumentError as error:
            raise ArgumentError("; ".join([str(error), *self.stderr_errors])) from None

    read_back = evaluated(Engine.read_back)
    fill_missing = evaluated(OtherProgram.fill_missing)
    neutralize_settings = evaluated(OtherProgram.neutralize_settings)

    def integrate(self, scene: Scene) -> Samples:
        """Run the scene; the time limit grows with the number of steps."""
        steps = scene.run.samples * scene.run.steps_per_sample
        samples: Samples = self._evaluate("integrate", scene, more=TIMEOUT_PER_STEP * steps)
        return samples

    def _evaluate(self, method: str, *arguments: Any, **named: Any) -> Any:
        return self._call(method, _run, method, *arguments, **named)

    @property
    def stderr_errors(self) -> list[str]:
        """Return the errors that the engine has printed so far."""
        errors = (line.partition("Error:")[2].strip() for line in self._child.output() if line.startswith("Error:"))
        return list(dict.fromkeys(errors))

    def _call(self, what: str, function: Callable[..., Any], *arguments: Any, more: float = 0.0, **named: Any) -> Any:
        words = f"{self.name}: {what} of {self._source}"
        return self._child.call(words, CALL_TIMEOUT + more, function, *arguments, **named)


FileEngine = OtherProgram | IsolatedEngine  # an engine that has loaded a foreign file
_idle: dict[tuple[str, int], ChildProcess] = {}  # key: engine name and process id; a forked process needs its own


def _keep(name: str, child: ChildProcess) -> None:
    if child.alive:
        _idle.setdefault((name, os.getpid()), child)


_loaded: dict[str, Any] = {}  # in the child process: the engine that it runs


def _load(name: str, source: Chain | ForeignFile) -> tuple[str, int]:
    engine = _loaded["engine"] = engines.load_here(name, source)
    return engine.version, engine.n


def _run(method: str, *arguments: Any, **named: Any) -> Any:
    return getattr(_loaded["engine"], method)(*arguments, **named)
