"""An engine in a process of its own, which a crash there, or no answer, cannot take along.

The process is `flexlink.engines.server`; questions and answers go through a pipe. It ends with this object, with this
process however that ends (its standard input is closed then), and by itself if an answer takes too long.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping
from multiprocessing import Pipe
from pathlib import Path
from typing import IO, Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, EngineError
from flexlink.describe.scene import Scene
from flexlink.engines.base import Array, File, Samples
from flexlink.engines.read_back import ReadBack

SECONDS = 300.0
"""For an answer, which takes milliseconds; but a first run may have to compile our kernels, which takes minutes."""
SECONDS_PER_STEP = 0.01
"""More for every step of a run."""


class IsolatedEngine:
    """The engine `name` with a chain or a file, as the protocol `Engine`; every question is asked in the other process.

    Raises
    ------
    FlexlinkError
        What the engine raises there.
    EngineError
        The engine failed in another way: its process crashed, or gave no answer in time.
    """

    def __init__(self, name: str, source: Chain | File) -> None:
        self.name, self._about = name, source.name if isinstance(source, Chain) else str(source.path)
        self._words = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as the process that writes into it
        self._pipe, theirs = Pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "flexlink.engines.server", str(theirs.fileno()), repr(SECONDS)],
            stdin=subprocess.PIPE, stdout=self._words, stderr=self._words, pass_fds=[theirs.fileno()],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)},
        )  # fmt: skip
        theirs.close()
        self._finalizer = weakref.finalize(self, _end, self._process, self._pipe, self._words)
        try:
            self.version, self.n = self._ask("load", name, source)
        except ArgumentError as error:
            raise ArgumentError("; ".join([str(error), *self.complaints])) from None

    def mass_matrix(self, q: Array) -> Array:
        """M(q)."""
        return np.asarray(self._ask("mass_matrix", q))

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC."""
        return np.asarray(self._ask("bias_torque", q, qd, tip_wrench=tip_wrench))

    def gravity_torque(self, q: Array) -> Array:
        """T_G."""
        return np.asarray(self._ask("gravity_torque", q))

    def elastic_torque(self, q: Array) -> Array:
        """T_FL."""
        return np.asarray(self._ask("elastic_torque", q))

    def friction_torque(self, qd: Array) -> Array:
        """T_FR."""
        return np.asarray(self._ask("friction_torque", qd))

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈."""
        return np.asarray(self._ask("forward_dynamics", q, qd, tau, tip_wrench=tip_wrench))

    def integrate(self, scene: Scene) -> Samples:
        """The scene's run, with more time for more steps."""
        steps = scene.run.samples * scene.run.steps_per_sample
        t, q, qd = self._ask("integrate", scene, more=SECONDS_PER_STEP * steps)
        return t, q, qd

    def read_back(self) -> ReadBack:
        """What the engine has read."""
        read: ReadBack = self._ask("read_back")
        return read

    def adopt(self, fields: Mapping[str, Array]) -> None:
        """Of a file: take what it does not say from elsewhere."""
        self._ask("adopt", fields)

    def put_right(self) -> None:
        """Of a file: leave nothing that acts beside gravity, springs and dampers."""
        self._ask("put_right")

    @property
    def complaints(self) -> list[str]:
        """What the engine has printed as errors so far."""
        errors = (line.partition("Error:")[2].strip() for line in self._lines() if line.startswith("Error:"))
        return list(dict.fromkeys(errors))

    def _ask(self, question: str, *arguments: object, more: float = 0.0, **named: object) -> Any:
        seconds = SECONDS + more
        try:
            self._pipe.send((seconds, question, arguments, named))
            answer = self._pipe.recv()
        except (EOFError, OSError):
            raise self._ended(question, seconds) from None
        except BaseException:  # Ctrl-C: nobody waits for the answer any more
            self._finalizer()
            raise
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _ended(self, question: str, seconds: float) -> BaseException:
        """Why there is no answer."""
        code = self._process.wait()
        if code == -signal.SIGINT:
            return KeyboardInterrupt()  # which was sent to both
        about = f"{self.name}, asked to {question.replace('_', ' ')} ({self._about})"
        if code == -signal.SIGALRM:
            return EngineError(f"{about}: no answer within {seconds:g} s; its process was ended")
        how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        return EngineError(f"{about}: its process {how}; its last words: {self._last_words()}")

    def _last_words(self) -> str:
        return next((line for line in reversed(self._lines()) if line), "none")

    def _lines(self) -> list[str]:
        if self._words.closed:
            return []
        self._words.seek(0)
        return [line.strip() for line in self._words.read().decode(errors="replace").split("\n")]


def _end(process: subprocess.Popen[bytes], pipe: Any, words: IO[bytes]) -> None:
    process.kill()
    process.wait()
    for file in (process.stdin, pipe, words):
        if file is not None:
            file.close()
