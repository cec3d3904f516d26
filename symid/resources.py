"""Where the files that come with symid are: robot files and templates.

Input: the name of a folder. Output: its path.

Supported: a source checkout, an editable installation (the folders stand beside the package),
a wheel (they stand in `symid/_data`).
Not supported: a package imported from inside a zip file.
"""

from pathlib import Path

from symid.errors import Notice, SymidError

__all__ = ["find_resource_folder"]

_PACKAGE = Path(__file__).resolve().parent


def find_resource_folder(name: str) -> Path:
    """Return the folder `name`, "robots" or "templates", that belongs to this installation.

    Raises:
        SymidError: the installation is incomplete; the message names the places looked at.
    """
    # The wheel's copy first: beside an installed package stand other people's folders.
    places = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for place in places:
        if place.is_dir():
            return place
    text = (
        f"the folder {name!r} that belongs to symid is missing, looked for {places[0]} and {places[1]}; "
        "install symid again"
    )
    raise SymidError(Notice(code="symid.missing-resource", text=text))
