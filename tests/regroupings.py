"""Groups that others published, as the matrix from our base parameters to theirs."""

from symid.dynamics.regrouping import check_independent, express_group


def derive_regrouping(base, groups, names=()):
    """Return the exact rows from our parameters to those of `groups`, which messages call `names`."""
    titles = [repr(name) for name in names] or [f"group {number}" for number in range(1, len(groups) + 1)]
    rows = [express_group(base, group, title) for title, group in zip(titles, groups, strict=True)]
    check_independent(rows, titles)
    return rows
