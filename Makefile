# Works on a machine with Python 3.11 or newer and make; everything else is installed into .venv.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready

.PHONY: demo test test-all lint docs bench generate clean
.DEFAULT_GOAL := test

demo: $(READY)
	@mkdir -p build
	$(BIN)/cadet-sym validate models/oleo_acceleration.toml --paths 2000 --plot build/oleo.png

test: lint
	$(BIN)/pytest -q -n auto --dist worksteal

test-all: lint
	$(BIN)/pytest -q -n auto --dist worksteal -m ""

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/pyright --threads

docs: $(READY)
	$(BIN)/python docs/build.py

# Beside its peers: some minutes.
bench: $(READY)
	$(BIN)/python benchmarks/run.py

# The C of the models that ship; the tests compare it with what the package writes.
generate: $(READY)
	for model in $(wildcard models/*.toml); do $(BIN)/cadet-sym export $$model --to generated/$$(basename $$model .toml) || exit 1; done

# Made when it is missing, and again when pyproject.toml changed.
$(READY): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.11")'
	@echo "Installing into .venv ..."
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check -e ".[dev]"
	@$(BIN)/python -m compileall -q cadet_sym  # as pip does of what is not editable: else the first run does, or each
	@touch $@

clean:
	rm -rf build dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
