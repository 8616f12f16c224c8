# `make demo` runs the main job, `make test` passes the tests, `make docs` builds the manual; each sets itself up.
# `make test-all` runs the slow tests as well: before a release.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt

# both set-ups write to one folder
.NOTPARALLEL:
.PHONY: run-env env demo test test-all docs pictures clean

# what a run and its report need, and no more
run-env: $(VENV)/.stamp

# the tools of the tests and of the manual as well
env: $(VENV)/.stamp-dev

$(VENV)/pyvenv.cfg: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "tis needs Python 3.11 or newer, this is " + sys.version.split()[0])'
	@echo "setting up $(VENV), about half a minute"
	@$(PYTHON) -m venv --clear $(VENV)

# Compiled on all cores; pip uses one. Packages hold a few files that do not compile, and nobody imports them.
$(VENV)/.stamp: $(VENV)/pyvenv.cfg
	@$(PIP) --editable '.[report]'
	@$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true
	@touch $@

# not compiled: the checks compile what they use
$(VENV)/.stamp-dev: $(VENV)/pyvenv.cfg
	@echo "adding the tools of tests and manual to $(VENV)"
	@$(PIP) --editable '.[report,dev,docs]'
	@touch $(VENV)/.stamp $@

demo: run-env
	@$(BIN)/tis run default || [ $$? -eq 5 ]  # 5: the run is not valid, and says why

test: env
	@deploy/check.sh -m 'not slow'

test-all: env
	@deploy/check.sh

docs: env
	@deploy/docs.sh
	@echo "the manual is docs/_build/html/index.html"

# by hand, when the report or the live page has changed; needs Debian's chromium
pictures: env
	@$(BIN)/python docs/pictures.py

clean:
	rm -rf $(VENV) runs docs/_build
