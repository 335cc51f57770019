# Two commands on a fresh machine: `make demo` and `make test`. Each sets up what it needs.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: demo test test-plain test-slow stress check format pictures bench bench-quick pages lessons docs clean

demo: $(VENV)/.kaju
	$(BIN)/kaju demo --out demo --force

# On two cores: a third worker computes while others wait for browsers, servers and commands.
WORKERS = -n 3 --dist worksteal

test: $(VENV)/.test
	$(BIN)/python -m pytest -m "not slow" $(WORKERS) --durations=10

# The suite of what computes in the plainest arithmetic of the processor: expectations that hang
# on a tie or on the last bit fail here. Other variants by hand: see CONTRIBUTING.md.
PLAIN = OPENBLAS_CORETYPE=Prescott NUMBA_CPU_NAME=generic NUMBA_DISABLE_INTEL_SVML=1 \
  NPY_DISABLE_CPU_FEATURES="$$($(BIN)/python tests/support/cpu_features.py)"

test-plain: $(VENV)/.test
	$(PLAIN) $(BIN)/python -m pytest -m "not slow" $(WORKERS) tests \
	  --ignore=tests/page --ignore=tests/view --ignore=tests/test_docs.py

test-slow: $(VENV)/.test
	$(BIN)/python -m pytest -m slow $(WORKERS)

# Random scenes for every verb: EXAMPLES of each kind. `make test` tries a few of them.
EXAMPLES ?= 500

stress: $(VENV)/.test
	KAJU_EXAMPLES=$(EXAMPLES) $(BIN)/python -m pytest tests/test_random_scenes.py $(WORKERS) \
		--hypothesis-show-statistics

# PETSc and mpi4py come from the system, for the system's Python, built for NumPy 1: an
# environment of its own sees them.
SCALE ?= .venv-scale
PETSC_DIR ?= $(firstword $(wildcard /usr/lib/petscdir/petsc*/*-real))
export PETSC_DIR

test-scale: $(SCALE)/.scale
	KAJU_NEEDS_PETSC=1 $(SCALE)/bin/python -m pytest tests/scale

$(SCALE)/.scale: pyproject.toml
	/usr/bin/python3 -m venv --system-site-packages $(SCALE)
	$(SCALE)/bin/pip install --quiet --editable . 'numpy>=1.26,<2' pytest hypothesis vtk
	touch $@

# Types are checked on the package as it is installed: the rooms below src/kaju.
check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	rm -rf build/types && mkdir -p build/types/kaju
	ln -s $(CURDIR)/src/kaju/* $(addprefix $(CURDIR)/,agents cli model view) build/types/kaju
	$(BIN)/mypy

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

$(VENV)/bin/pip:
	$(PYTHON) -m venv $(VENV)

SETUP := pyproject.toml setup.py | $(VENV)/bin/pip
INSTALL = $(BIN)/pip install --quiet --editable

$(VENV)/.kaju: $(SETUP)
	$(INSTALL) .
	touch $@

$(VENV)/.page: $(SETUP)
	$(INSTALL) '.[page]'
	touch $@ $(VENV)/.kaju

$(VENV)/.test: $(SETUP)
	$(INSTALL) '.[test]'
	touch $@ $(VENV)/.page $(VENV)/.kaju

$(VENV)/.dev: $(SETUP)
	$(INSTALL) '.[dev]'
	touch $@ $(VENV)/.test $(VENV)/.page $(VENV)/.kaju

pictures: $(VENV)/.test
	for script in docs/draw_*.py; do $(BIN)/python $$script || exit 1; done

# Time against error of every method, and the record in docs: half an hour on a quiet machine or
# more; `make bench-quick` some minutes, without a record.
bench: $(VENV)/.test
	$(BIN)/python benchmarks/work_precision.py --publish benchmarks/results

bench-quick: $(VENV)/.test
	$(BIN)/python benchmarks/work_precision.py --quick benchmarks/results/quick

pages: $(VENV)/.page
	$(BIN)/python docs/make_pages.py

# All lessons in one file, for a class or a colleague without Python.
lessons: $(VENV)/.page
	$(BIN)/python tools/release.py --lessons $$($(BIN)/python -c 'import kaju; print(kaju.__version__)')

# The site, in site/: texts, lessons with their pages, tutorials that ran, and the public names.
docs: $(VENV)/.docs
	$(BIN)/python docs/make_pages.py docs/pages
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	$(BIN)/python -m sphinx -W --keep-going -q -b linkcheck docs docs/_build/links
	rm -rf site && cp -r docs/_build/html site && cp -r docs/pages site/pages

$(VENV)/.docs: $(VENV)/.test
	$(INSTALL) '.[test,docs]'
	touch $@

clean:
	rm -rf $(VENV) demo build dist *.egg-info src/*.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
