# `make demo` runs the main job, `make test` passes the tests; each sets itself up.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: env demo test clean

env: $(VENV)/.stamp

$(VENV)/.stamp: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "tis needs Python 3.11 or newer, this is " + sys.version.split()[0])'
	@echo "setting up $(VENV), about half a minute"
	@$(PYTHON) -m venv --clear $(VENV)
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev,docs]'
	@touch $@

demo: env
	@$(BIN)/tis run default

test: env
	@deploy/check.sh

clean:
	rm -rf $(VENV) runs
