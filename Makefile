# make demo    the main job on built-in synthetic drops, no download
# make test    the whole test suite
# make bench   every benchmark, one after the other
# make docs    the site, strictly, into site/
PYTHON ?= python3
PY := .venv/bin/python
# Measured data is not in the repository; a folder of it in or beside the checkout is found.
CONTACTLEARN_DATA ?= $(firstword $(abspath $(wildcard data ../data ../shared/data)))
export CONTACTLEARN_DATA

.PHONY: demo test bench docs clean

demo: .venv/ready
	$(PY) evaluate.py

# The tests open the report in Chromium where there is one; a bare machine that runs CI gets one.
test: .venv/ready
	@if [ "$$CI" = true ] && [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && ! command -v chromedriver >/dev/null; then \
	  { timeout 120 apt-get -qq update && DEBIAN_FRONTEND=noninteractive timeout 300 apt-get -qq install -y --no-install-recommends chromium chromium-driver; } </dev/null >/dev/null 2>&1 || \
	  echo "Chromium could not be installed: the report is not tested in a browser"; fi
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m pyright --pythonpath $(PY)
	$(PY) -m pytest

bench: .venv/ready
	$(PY) -m pip install --disable-pip-version-check -q -c requirements.lock -e '.[test,bench]'
	for script in benchmarks/[a-z]*.py; do $(PY) $$script || exit 1; done

docs: .venv/ready
	$(PY) -m sphinx -W --keep-going -q -d .sphinx -c docs . site
	@echo "open     site/index.html"

# The lock file pins every package; it is made again from pyproject.toml as CONTRIBUTING.md says.
.venv/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "contactlearn needs Python 3.11 or newer; say which with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv .venv
	$(PY) -m pip install --disable-pip-version-check -c requirements.lock -e '.[test]'
	touch $@

clean:
	rm -rf .venv outputs multirun site .sphinx
