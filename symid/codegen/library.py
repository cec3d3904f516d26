"""A robot's functions, ready to call: compiled C, the NumPy module, or CasADi.

Input: a folder of generated sources, for C with the shared library in it. Output: `Library`.

Supported: one sample and batches; double precision, and float libraries through conversion.
Not supported: shared libraries of another machine, or built from other sources than the folder's.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from symid.arrays import FloatArray
from symid.codegen.backends import CompiledLibrary, PythonLibrary, import_module
from symid.codegen.build_digest import find_build_digest
from symid.codegen.calls import Call
from symid.codegen.casadi_library import CasadiLibrary, load_casadi_library
from symid.codegen.functions import ModelCard, read_model_card
from symid.codegen.writer import find_listed, read_manifest
from symid.errors import Notice, UsageError

__all__ = ["Library", "Loaded", "load_library"]

Loaded = CompiledLibrary | PythonLibrary | CasadiLibrary


class Library(Protocol):
    """The functions of a model card, however they are computed."""

    @property
    def card(self) -> ModelCard:
        """Return the model behind the functions."""
        ...

    @property
    def backend(self) -> str:
        """Return "c", "python" or "casadi"."""
        ...

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Return what a user should know, for example that there was no compiler."""
        ...

    def evaluate(
        self, name: str, *inputs: FloatArray, out: Sequence[FloatArray] | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the outputs of function `name`.

        Contiguous arrays of float64 are read where they are. The system hands out new arrays of many
        megabytes page by page, which can cost as much as the computation: in a loop over such batches,
        give the arrays of one pass as `out` to the next.

        Args:
            name: of a function in the card.
            inputs: (N, *shape) each, or all of one sample's shape; shared vectors (size,).
            out: a tuple of arrays to write the outputs to and return, contiguous, float64, of the outputs'
                shapes, without memory in common; None for new ones. An input that shares memory with
                them is copied first.

        Raises:
            UsageError: the function does not exist, an input has a wrong shape or no real numbers, or `out`
                cannot take the outputs.
        """
        ...

    def bind(self, name: str, *, out: Sequence[FloatArray] | None = None) -> Call:
        """Return function `name` for one sample at a time, with little overhead.

        A call refuses with UsageError what is not one sample of real numbers. One bound function
        belongs to one thread; bind another for another thread.

        Args:
            name: of a function in the card.
            out: as for `evaluate`, of one sample's shapes: every call overwrites and returns these arrays.
                None for new ones in each call.

        Raises:
            UsageError: the function does not exist, or `out` cannot take the outputs.
        """
        ...


def _find_text(manifest: Mapping[str, object], key: str, folder: Path) -> str:
    value = manifest.get(key)
    if not isinstance(value, str):
        text = f"the manifest has no {key!r}; generate the folder again"
        raise UsageError(Notice(code="usage.broken-manifest", text=text, file=str(folder)))
    return value


def load_library(folder: Path, *, notices: tuple[Notice, ...] = ()) -> Loaded:
    """Return the library in a folder that symid generated; C needs `make shared` first.

    A folder for CasADi works as it is; after `make shared` its compiled C is used, which is faster.

    Raises:
        UsageError: the folder holds no generated library, or its C was not compiled since it was written.
        GenerationError: the library does not load on this machine.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        text = "holds no library of symid: there is no manifest.json that it wrote"
        raise UsageError(Notice(code="usage.no-library", text=text, file=str(folder)))
    try:
        card = read_model_card(json.dumps(manifest["card"]))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        text = f"the manifest holds no model card ({error}); generate the folder again"
        raise UsageError(Notice(code="usage.broken-manifest", text=text, file=str(folder))) from error
    prefix = _find_text(manifest, "prefix", folder)
    if manifest.get("target") == "python":
        return PythonLibrary(card, import_module(folder / f"{prefix}.py"), notices)
    precision = _find_text(manifest, "precision", folder)
    digest = find_build_digest(card, prefix=prefix, precision=precision, files=find_listed(manifest))
    if manifest.get("target") == "casadi":
        return load_casadi_library(folder, card, prefix=prefix, digest=digest, notices=notices)
    binary = folder / f"lib{prefix}.so"
    if not binary.is_file():
        text = f"has no {binary.name}; run `make shared` in it"
        raise UsageError(Notice(code="usage.not-compiled", text=text, file=str(folder)))
    return CompiledLibrary(card, binary, prefix=prefix, precision=precision, digest=digest, notices=notices)
