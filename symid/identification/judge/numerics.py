"""Numbers of pure numerics, shared by the rooms of identification: they decide nothing about data.

Changing one by a factor of ten changes results in digits that nobody prints.
"""

RIDGE = 1e-11
"""Of the squared length of columns: keeps what rows do not determine at zero."""
RANK = 1e-10
"""Singular value over the largest one, of columns of length one, below which it is rounding."""
EXACT = 1e-12
"""Part of a quantity that is rounding."""
TINY = 1e-300
"""In place of zero as a divisor."""
CONVERGED = 1e-6
"""Relative change at which an iteration ends."""
ROUNDS = 30
"""Of an iteration, at most."""
BLOCK = 1024
"""Samples whose columns are computed or condensed at a time: they stay in the cache of a core."""
LARGEST = 2e8
"""Bytes of equations that are held in memory."""
EXCHANGES = 1000
"""Of signs at random: a chance of 0.1 is known within 0.01."""
