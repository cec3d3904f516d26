"""Small functions in C that statements of programs call: sign, comparisons, the greater of two.

Input: the name of an operation. Output: the text of a static function.

Supported: double and float; NaN goes through.
"""

__all__ = ["write_helper"]

# Comparisons with NaN are false: each helper lets a NaN through by its last branch.
_HELPERS = {
    "sign": "static {real} sign({real} x)\n"
    "{{\n    return x > {zero} ? {one} : (x < {zero} ? -{one} : x);\n}}",
    "less": "static {real} less({real} a, {real} b)\n"
    "{{\n    return a < b ? {one} : (a >= b ? {zero} : a + b);\n}}",
    "less_equal": "static {real} less_equal({real} a, {real} b)\n"
    "{{\n    return a <= b ? {one} : (a > b ? {zero} : a + b);\n}}",
    "is_zero": "static {real} is_zero({real} x)\n"
    "{{\n    return x > {zero} || x < {zero} ? {zero} : (x == {zero} ? {one} : x);\n}}",
    "maximum": "static {real} maximum({real} a, {real} b)\n"
    "{{\n    return a > b ? a : (a <= b ? b : a + b);\n}}",
    "minimum": "static {real} minimum({real} a, {real} b)\n"
    "{{\n    return a < b ? a : (a >= b ? b : a + b);\n}}",
    "select": "static {real} select({real} condition, {real} x)\n"
    "{{\n    return condition > {zero} || condition < {zero} ? x : condition;\n}}",
}


def write_helper(name: str, real: str) -> str:
    """Return the definition of the helper `name` for numbers of type `real`."""
    suffix = "f" if real == "float" else ""
    return _HELPERS[name].format(real=real, zero=f"0.0{suffix}", one=f"1.0{suffix}")
