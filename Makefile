# `make demo` runs the main job, `make test` passes the tests, `make docs` builds the manual; each sets itself up.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: env demo test docs pictures clean

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

docs: env
	@deploy/docs.sh
	@echo "the manual is docs/_build/html/index.html"

# by hand, when the report or the live page has changed; needs Debian's chromium
pictures: env
	@$(BIN)/python docs/pictures.py

clean:
	rm -rf $(VENV) runs docs/_build
