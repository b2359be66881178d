"""Commands of setuptools: a wheel also contains examples and scenes; the package's description has no dead links."""

from __future__ import annotations

import sys
from pathlib import Path

from description import standalone
from setuptools.command.build_py import build_py
from setuptools.command.egg_info import egg_info

ROOT = Path(__file__).parent.parent


class WithExamples(build_py):
    """Copies what `flexlink examples` lists into the wheel; an editable install reads it from the checkout."""

    def run(self) -> None:
        """Copy the library, then examples and scenes."""
        super().run()
        if not self.editable_mode:
            for path, source in self._copies().items():
                self.mkpath(str(Path(path).parent))
                self.copy_file(str(source), path)

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """Files in the wheel."""
        added = [] if self.editable_mode else [*self._copies()]
        return [*super().get_outputs(include_bytecode), *added]

    def _copies(self) -> dict[str, Path]:
        sys.path.insert(0, str(ROOT))
        try:
            from flexlink.cli.examples import bundled  # noqa: PLC0415  of this checkout, with the packages of the build
        finally:
            sys.path.remove(str(ROOT))
        folder = Path(self.build_lib, "flexlink", "bundled")
        return {str(folder / path): source for path, source in bundled().items()}


class WithPlainDescription(egg_info):
    """Takes the README as description, which a page outside the repository can show."""

    def finalize_options(self) -> None:
        """Change the description before any metadata is written."""
        super().finalize_options()
        metadata = self.distribution.metadata
        metadata.long_description = standalone(metadata.long_description, metadata.project_urls.get("Source", ""))
