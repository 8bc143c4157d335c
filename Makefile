# The Python (3.11 or newer) that the environment is made with: make PYTHON=python3.12 figures
PYTHON ?= python3
BIN := .venv/bin
LINT := .venv-lint/bin
SITE := .venv-docs/bin
CRATE := .venv-deposit/bin
PEERS := .venv-peers/bin

.PHONY: figures check peers cluster deposit docs performance pictures test cf lint format reference pins clean

# Every figure, error and claim of the paper; or of another configuration: make figures CONFIG=...
CONFIG ?=
figures: .venv/ready
	$(if $(CONFIG),$(BIN)/python -m sphpod check $(CONFIG))
	$(BIN)/snakemake --cores 2 $(if $(CONFIG),--configfile $(CONFIG))

# What is wrong with a configuration, or what it asks for
check: .venv/ready
	$(BIN)/python -m sphpod check $(or $(CONFIG),config/config.yaml)

# Other tools on one of the scenes, in an environment of their own: results/peers.md
peers: .venv-peers/ready
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PEERS)/python -m benchmarks.peers

# What a SLURM cluster takes beside: docs/cluster.md
cluster: .venv/ready
	$(BIN)/pip install --quiet --disable-pip-version-check --requirement environment-cluster.txt

# A folder to deposit, with checksums and RO-Crate metadata, of all that has been built
deposit: figures .venv-deposit/ready
	$(BIN)/snakemake --report report.html
	PYTHONPATH=. $(CRATE)/python -m sphpod.pipeline.deposit deposit
	$(CRATE)/rocrate-validator -y validate --profile-identifier ro-crate-1.1 deposit

# The documents as a site: site/index.html; with the figures that have been built
docs: .venv/ready .venv-docs/ready
	PYTHONPATH=. $(SITE)/mkdocs build --strict

# The tables of docs/performance.md, of the target benchmarks
performance: .venv/ready
	$(BIN)/python docs/performance.py

# The pictures of the documents, from the figures of one build: make figures, then targets
# benchmarks and stability
pictures: .venv/ready
	$(BIN)/python docs/images/reduce.py

test: .venv/ready
	$(BIN)/python -m pytest

# The checker of CF, by which tests look at a file of every kind where it is there
cf: .venv-cf/ready

lint: .venv/ready .venv-lint/ready
	$(LINT)/ruff check .
	$(LINT)/ruff format --check .
	$(LINT)/snakefmt --check Snakefile workflow
	$(LINT)/codespell
	$(BIN)/mypy

format: .venv-lint/ready
	$(LINT)/ruff check --fix .
	$(LINT)/ruff format .
	$(LINT)/snakefmt Snakefile workflow

# docs/reference.md, of what studies and the schema of the configuration declare
reference: .venv/ready
	$(BIN)/python docs/reference.py

# The pinned packages of both environments, compiled from pyproject.toml by uv (pip install uv);
# what is pinned stays: make pins UPGRADE=--upgrade takes the newest
UPGRADE ?=
COMPILE = uv pip compile --python-version 3.11 --annotation-style line --quiet $(UPGRADE) --custom-compile-command "make pins"
pins:
	echo "--editable .[tests]" | $(COMPILE) - --output-file environment.txt
	$(COMPILE) --group lint --output-file environment-lint.txt
	$(COMPILE) --group deposit --output-file environment-deposit.txt
	$(COMPILE) --group cf --output-file environment-cf.txt
	echo "--editable ." | $(COMPILE) --group docs - --output-file environment-docs.txt
	echo snakemake-executor-plugin-cluster-generic | $(COMPILE) --no-deps - --output-file environment-cluster.txt

# Everything that the pipeline made; the environment stays
clean:
	rm -rf results figures/*.pdf figures/*.png report.html .snakemake

CHECK_PYTHON = $(PYTHON) -c 'import os, sys; sys.exit("Python 3.11 or newer is needed: make PYTHON=..." if sys.version_info < (3, 11) else "This folder has a space in its path, with which Snakemake runs no scripts: move it" if len(os.getcwd().split()) > 1 else 0)'

# The environment, made anew only when its list of packages has changed
.venv/ready: environment.txt
	@$(CHECK_PYTHON)
	rm -rf .venv
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --requirement environment.txt
	touch $@

# Those of the checkers of text and of CF files, of what describes a deposit, and of the site, whose pages of functions
# and figures come from the package
.venv-%/ready: environment-%.txt
	@$(CHECK_PYTHON)
	rm -rf $(@D)
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/pip install --quiet --disable-pip-version-check --requirement $<
	touch $@

# That of the other tools; PySPH needs a compiler, and is left out where it cannot be built
.venv-peers/ready: benchmarks/peers/environment.txt benchmarks/peers/pysph.txt
	@$(CHECK_PYTHON)
	rm -rf .venv-peers
	$(PYTHON) -m venv .venv-peers
	$(PEERS)/pip install --quiet --disable-pip-version-check --requirement benchmarks/peers/environment.txt
	$(PEERS)/pip install --quiet --disable-pip-version-check --requirement benchmarks/peers/pysph.txt || echo "PySPH could not be installed; the comparison goes on without it."
	touch $@
