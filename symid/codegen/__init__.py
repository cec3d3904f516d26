"""Functions, generated sources and the libraries built from them."""
