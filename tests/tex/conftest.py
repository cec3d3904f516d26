"""Tests of documents in LaTeX: `make test-tex` runs them, `make test` does not."""


def pytest_configure(config):
    config.addinivalue_line("markers", "tex: documents under pdflatex; `make test-tex` runs these")


def pytest_ignore_collect(config):
    return True if "tex" not in config.option.markexpr else None
