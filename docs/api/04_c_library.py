"""Compile the robot's functions, and call one with one sample and with a batch."""

import numpy as np

import symid

lib = symid.load("two_link").compile()
print(lib.mass_matrix)
print(lib.mass_matrix([0.1, 0.5], lib.beta))
print(lib.mass_matrix(np.zeros((1000, 2)), lib.beta).shape)
