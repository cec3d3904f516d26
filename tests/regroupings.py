"""Groups that others published, as the matrix from our base parameters to theirs."""

from symid.dynamics.regrouping import build_regrouping, express_group


def derive_regrouping(base, groups, names=()):
    """Return the exact matrix from our parameters to those of `groups`, which messages call `names`."""
    titles = [repr(name) for name in names] or [f"group {number}" for number in range(1, len(groups) + 1)]
    rows = [express_group(base, group, title) for title, group in zip(titles, groups, strict=True)]
    return build_regrouping(base, rows, titles)
