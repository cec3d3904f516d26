"""Take the mass matrix as exact SymPy expressions, and differentiate it."""

import symid

mass_matrix = symid.load("two_link").sympy("mass_matrix")
print(mass_matrix.expr[0, 0])
print(mass_matrix.expr[0, 0].diff(mass_matrix.inputs["q"][1]))
print(mass_matrix.latex())
