# The Python (3.11 or newer) that the environment is made with: make PYTHON=python3.12 figures
PYTHON ?= python3
BIN := .venv/bin

.PHONY: figures test lint format clean

# Every figure, error and claim of the paper
figures: .venv/ready
	$(BIN)/snakemake --cores 2

test: .venv/ready
	$(BIN)/python -m pytest

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/mypy

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile workflow

# Everything that the pipeline made; the environment stays
clean:
	rm -rf results figures/*.pdf figures/*.png report.html .snakemake

# The environment, made anew only when its list of packages has changed
.venv/ready: environment.txt
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed: make PYTHON=..." if sys.version_info < (3, 11) else 0)'
	rm -rf .venv
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --requirement environment.txt
	touch $@
