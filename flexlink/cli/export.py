"""The command `flexlink export`."""

import argparse
import functools
import math
from collections.abc import Callable
from pathlib import Path

from flexlink.chain.arguments import positive
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain
from flexlink.cli.shared import OF_ENGINES, prefix_errors, print_lines, require_writable, varied_scene
from flexlink.common.errors import ArgumentError
from flexlink.common.output import make_folder, write_whole
from flexlink.common.types import Array
from flexlink.data.documents import shown_path
from flexlink.describe.scene import Scene
from flexlink.describe.tie import refuse_ties
from flexlink.formats import FORMATS
from flexlink.formats.code import to_c, to_casadi, to_fmu
from flexlink.formats.features import storage_note, unsupported
from flexlink.formats.small_mass import added_inertia, with_small_mass
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.results.files import ending


def run_command(options: argparse.Namespace) -> int:
    """Write files for all scenes, or none if there is an error, and print what the formats cannot represent."""
    if options.small_mass is not None:
        positive("--small-mass", options.small_mass)
    code = _code_writers(options)
    texts: dict[Path, str | bytes] = {}
    notes: list[str] = []
    for path in options.scenes:
        scene = varied_scene(path, options)
        with prefix_errors(path):
            if code:
                refuse_ties(scene.ties, "C code, CasADi code and FMUs have no ties")
            chain, state = _chain_and_state(path, scene, options, notes)
            texts |= {target: write(chain, state, scene) for target, write in code.items()}
        for name in _formats(options):
            target = options.out / (path.stem + FORMATS[name].ending)
            if target in texts:
                why = f"{path}: {target} would overwrite another scene's file; export one at a time"
                raise ArgumentError(why, id="would-overwrite")
            with prefix_errors(path):
                notes += _missing(target, scene, chain, name, strict=options.strict)
                more = {"initial": state, "ties": scene} if FORMATS[name].keyframe else {}
                texts[target] = FORMATS[name].write(chain, **more)
    for path in texts:
        if not path.parent.exists():
            make_folder(path.parent)
        require_writable(path)
    for path, text in texts.items():
        content = text.encode() if isinstance(text, str) else text
        write_whole(path, functools.partial(Path.write_bytes, data=content))
        print(shown_path(path))
    print_lines("note", notes)
    options.document = {"files": [str(path) for path in texts], "notes": notes}
    return 0


def _formats(options: argparse.Namespace) -> list[str]:
    """Names of the requested formats; by default all, or none if code is requested."""
    return list(dict.fromkeys(options.format or ([] if options.c or options.casadi or options.fmu else FORMATS)))


def _code_writers(options: argparse.Namespace) -> dict[Path, Callable[..., str | bytes]]:
    """Writers of the requested code files, by path."""
    if options.out.suffix in OF_ENGINES and not options.out.is_dir():
        text = f"--out {options.out}: files are named after the scenes; give their folder, --out {options.out.parent}"
        raise ArgumentError(text, id="unknown-format")

    def fmu(chain: Chain, state: tuple[Array, Array], scene: Scene) -> bytes:
        how, run = {"fmi": options.fmi, "binary": not options.no_binary, "scene": scene}, scene.run
        return to_fmu(chain, state, sample=run.between, duration=run.duration or 1.0, **how)

    known: tuple[tuple[Path | None, Callable[..., str | bytes], str, str], ...] = (
        (options.c, lambda chain, *_: to_c(chain, slopes=options.slopes, step=options.step), ".c", "C code"),
        (options.casadi, lambda chain, *_: to_casadi(chain), ".py", "code for CasADi"),
        (options.fmu, fmu, ".fmu", "an FMU"),
    )
    writers = {}
    for path, write, end, what in known:
        if path is not None:
            ending(path, (end,), what)
            writers[options.out / path] = write
    if writers and len(options.scenes) > 1:
        raise ArgumentError("--c, --casadi, --fmu: one scene per file; export one at a time", id="would-overwrite")
    return writers


def _chain_and_state(
    path: Path, scene: Scene, options: argparse.Namespace, notes: list[str]
) -> tuple[Chain, tuple[Array, Array] | None]:
    """Return the chain, with small masses on request, and the initial state if a format stores it."""
    chain, mass = lump(open_chain(scene)), options.small_mass
    keyframe = any(FORMATS[name].keyframe for name in _formats(options))
    state = initial_state(scene, chain) if keyframe or options.fmu or mass is not None else None
    if state is not None and mass is not None:
        added = added_inertia(chain, state[0], mass=mass)
        gets = f"every massless link gets {mass:g} kg; relative changes in the initial configuration"
        changes = f"mass matrix at most +{added:.2g}, frequencies at most −{1 - 1 / math.sqrt(1 + added):.2g}"
        notes.append(f"{path}: {gets}: {changes}")
        chain = with_small_mass(chain, mass=mass)
    return chain, state


def _missing(target: Path, scene: Scene, chain: Chain, format: str, *, strict: bool) -> list[str]:
    """Return a note on what a format cannot represent; with `--strict`, raise an error."""
    missing = unsupported(scene, chain, format=format)
    if missing and strict:
        text = f"--strict: {format} cannot represent {', '.join(missing)}; no file written"
        raise ArgumentError(text, id="not-representable")
    return [storage_note(target, missing, format=format)] if missing else []
