"""What a compiled library must have been built from: one digest, in the library and in the manifest's words.

Input: the model card, the precision and the digests of the sources. Output: 64 hexadecimal digits.

Supported: C libraries. Not supported: flags of the compiler.
"""

from collections.abc import Mapping

from symid.codegen.functions import ModelCard, write_model_card
from symid.provenance import find_signature

__all__ = ["find_build_digest"]


def find_build_digest(card: ModelCard, *, prefix: str, precision: str, files: Mapping[str, str]) -> str:
    """Return the digest of all that fixes the interface of a library and its numbers.

    Args:
        card: the model.
        prefix: of the names in the library.
        precision: "double" or "float".
        files: digest by path; headers and functions count. The file that holds this digest does not.
    """
    info = f"{prefix}_info.c"
    compiled = {
        path: digest
        for path, digest in files.items()
        if path == f"{prefix}.h"
        or (path.startswith(f"{prefix}_") and path.endswith((".c", ".h")) and path != info)
    }
    return find_signature(prefix, precision, write_model_card(card), compiled)
