# Each target makes the environment it needs in .venv; nothing has to be installed or active before.
#   make demo    simulate, generate, identify, validate, report, on a two-link arm
#   make check   before every commit: style, types, the rules of the house, all that is quick
#   make test    style, types, and tests of every feature
#   make test-all         style, types, and all tests
#   make study   elastic joints whose hidden models are not those of symid, 10 seeds; takes an hour or two
#   make test-browser     lessons in a headless Chromium
#   make test-tex         documents of lessons under pdflatex
#   make test-slurm       a fleet of 200 jobs on one node of SLURM, started for it
#   make test-fuzz        every reader of files, ten minutes each (FUZZ_SECONDS), guided by coverage
#   make test-embedded    generated C under other compilers, sanitizers, cppcheck, and on Cortex-M in QEMU
# PYTHON is the interpreter that .venv is made from (3.11 or later).

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
# Every file that is installed has the hash that its lock names; `make locks` writes the locks.
LOCKS := .ci/locks
# Modules are compiled when first imported: most of them never are.
INSTALL := $(PIP) install --quiet --no-compile --no-deps --require-hashes --requirement
# symid itself is built by what is installed: nothing is downloaded that no lock names.
ITSELF := $(PIP) install --quiet --no-deps --no-build-isolation --editable .
DEMO := demo
WORKERS ?= 2
# Folders of tests that need no compiler and are quick.
QUICK := tests/architecture $(addprefix tests/unit/,kernel robot logs dynamics excitation report)
FUZZ_SECONDS ?= 600
# A worker a core: threads of the linear algebra would only wait for each other, and change last digits.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest
# Tests of a file share what they make; tests/conftest.py puts files that take long first.
SPREAD := --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder
# Program and the Debian package that has it.
EMBEDDED := gcc:gcc clang:clang cppcheck:cppcheck arm-none-eabi-gcc:gcc-arm-none-eabi qemu-system-arm:qemu-system-arm

# Compiled modules are kept, even where the environment says otherwise: tests start many processes.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help demo study check test test-all test-slow test-browser browser-packages test-tex tex-packages test-slurm slurm-packages test-embedded test-fuzz embedded-packages lint docs wheel wheel-twice materials locks audit benchmark clean

help:
	@sed -n 's/^#   //p' Makefile
	@echo "make lint, test-slow, docs, wheel, wheel-twice, materials, locks, audit, benchmark, embedded-packages, browser-packages, tex-packages, slurm-packages, clean"

$(VENV)/made:
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "symid needs Python 3.11 or later, set PYTHON")'
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/core: $(VENV)/made pyproject.toml $(LOCKS)/core.txt
	$(INSTALL) $(LOCKS)/core.txt
	$(ITSELF)
	@touch $@

$(VENV)/dev: $(VENV)/made pyproject.toml $(LOCKS)/dev.txt
	$(INSTALL) $(LOCKS)/dev.txt
	$(ITSELF)
	@touch $@ $(VENV)/core

$(VENV)/docs: $(VENV)/made pyproject.toml $(LOCKS)/docs.txt
	$(INSTALL) $(LOCKS)/docs.txt
	$(ITSELF)
	@touch $@ $(VENV)/core

# For `make locks` and `make audit`.
$(VENV)/tools: $(VENV)/made $(LOCKS)/tools.txt
	$(INSTALL) $(LOCKS)/tools.txt
	@touch $@

demo: $(VENV)/core
	$(BIN)/symid demo --output $(DEMO) --force

study: $(VENV)/core
	$(BIN)/symid study foreign --seeds 10 --jobs $(WORKERS)

lint: $(VENV)/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The tests come last, so that pytest's closing line is the last one.
check: lint
	$(PYTEST) $(SPREAD) -m "not slow and not long" $(QUICK)

test: lint
	$(PYTEST) $(SPREAD) -m "not slow and not long"

test-all: lint
	$(PYTEST) $(SPREAD) $(REST)

# Every URDF of a package of seventy.
test-slow: $(VENV)/dev
	$(PYTEST) -m slow --quiet tests/oracle/test_urdf_robots.py

# What test-embedded still wants of Debian, a package a line; nothing if all is there.
embedded-packages:
	@for pair in $(EMBEDDED); do command -v $${pair%%:*} >/dev/null || echo $${pair##*:}; done
	@ls $$(clang -print-resource-dir 2>/dev/null)/lib/*/libclang_rt.asan* >/dev/null 2>&1 || echo libclang-rt-dev
	@echo '#include <stdio.h>' | arm-none-eabi-gcc -fsyntax-only -x c - 2>/dev/null || echo libnewlib-arm-none-eabi

# Its figures stand at the end: sizes, stack, instructions, errors, last lines of self-tests.
test-embedded: $(VENV)/dev
	@missing=$$($(MAKE) --silent --no-print-directory embedded-packages | paste -sd' '); \
	if [ -n "$$missing" ]; then \
		echo "test-embedded wants programs that are not here; as root: apt-get install --no-install-recommends $$missing"; \
		exit 1; \
	fi
	$(PYTEST) -m embedded --numprocesses $(WORKERS) tests/embedded

# What test-browser still wants of Debian; nothing if it is there.
browser-packages:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null || echo chromium

# axe-core, the rules for pages that everybody can read, comes with this package; of the package itself nothing is used.
$(VENV)/axe: $(VENV)/dev $(LOCKS)/axe.txt
	$(INSTALL) $(LOCKS)/axe.txt
	@touch $@

# Without atheris, which not every machine has a wheel of, inputs are changed at random.
test-fuzz: $(VENV)/dev
	-$(PIP) install --quiet atheris
	OMP_NUM_THREADS=1 $(BIN)/python tests/fuzz/readers.py --seconds $(FUZZ_SECONDS) $(FUZZ_READERS)

# Pages are opened, moved, dragged and printed; what they show is compared with the library.
test-browser: $(VENV)/dev
	@missing=$$($(MAKE) --silent --no-print-directory browser-packages); \
	if [ -n "$$missing" ]; then \
		echo "test-browser wants programs that are not here; as root: apt-get install --no-install-recommends $$missing"; \
		exit 1; \
	fi
	@$(MAKE) --silent --no-print-directory $(VENV)/axe
	$(PYTEST) -m browser $(SPREAD) tests/browser

# What test-tex still wants of Debian; nothing if it is there. 100 MB, so that .ci/run leaves it out.
tex-packages:
	@command -v pdflatex >/dev/null || echo texlive-latex-base
	@kpsewhich lmodern.sty >/dev/null 2>&1 || echo lmodern
	@kpsewhich ngerman.ldf >/dev/null 2>&1 || echo texlive-lang-german

test-tex: $(VENV)/dev
	@missing=$$($(MAKE) --silent --no-print-directory tex-packages); \
	if [ -n "$$missing" ]; then \
		echo "test-tex wants programs that are not here; as root: apt-get install --no-install-recommends $$missing"; \
		exit 1; \
	fi
	$(PYTEST) -m tex tests/tex

# What test-slurm still wants of Debian; nothing if it is there. Its daemons run as this user, and end with it.
slurm-packages:
	@PATH="$$PATH:/usr/sbin"; command -v munged >/dev/null || echo munge
	@PATH="$$PATH:/usr/sbin"; command -v slurmctld >/dev/null && command -v slurmd >/dev/null || echo slurm-wlm

$(VENV)/slurm: $(VENV)/dev $(LOCKS)/slurm.txt
	$(INSTALL) $(LOCKS)/slurm.txt
	@touch $@

test-slurm: $(VENV)/dev
	@missing=$$($(MAKE) --silent --no-print-directory slurm-packages | paste -sd' '); \
	if [ -n "$$missing" ]; then \
		echo "test-slurm wants programs that are not here; as root: apt-get install --no-install-recommends $$missing"; \
		exit 1; \
	fi
	@$(MAKE) --silent --no-print-directory $(VENV)/slurm
	$(PYTEST) -m slurm tests/slurm

docs: $(VENV)/docs
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

wheel: $(VENV)/core
	$(PIP) wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .

# The same bytes twice, from two copies of the source, and what they need as CycloneDX.
wheel-twice: wheel
	@rm -rf build/again && mkdir -p build/again && git archive HEAD | tar -x -C build/again
	@rm -rf build/first && mkdir -p build/first && git archive HEAD | tar -x -C build/first
	@for copy in first again; do $(PIP) wheel --quiet --no-deps --no-build-isolation \
		--wheel-dir build/$$copy/dist build/$$copy; done
	cmp build/first/dist/*.whl build/again/dist/*.whl
	@sha256sum build/first/dist/*.whl

# Versions and hashes of all that the environments are made from, for every Python that symid supports.
locks: $(VENV)/tools
	$(BIN)/python .ci/locks.py

# Asks PyPI for advisories on all that is locked; what cannot be asked is an error, too.
audit: $(VENV)/tools
	@for lock in $(LOCKS)/*.txt; do \
		echo "$$lock"; $(BIN)/pip-audit --strict --disable-pip --require-hashes --requirement $$lock || exit 1; \
	done

materials: $(VENV)/core
	@mkdir -p dist
	$(BIN)/python .ci/materials.py > dist/symid.cdx.json

benchmark: $(VENV)/core
	$(BIN)/python benchmarks/startup.py

clean:
	rm -rf $(VENV) build dist docs/_build $(DEMO) .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
