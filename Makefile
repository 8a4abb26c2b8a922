# make demo       a diagnosis of simulated drops with hidden physics, no download of data
# make quick      the inner loop: tests of what changed since the last commit
# make test       style, types, the test suite, and a fresh install without the lock file
# make test-all   with all cases of each test, and with the long tests for which a faster one stands
# make bench      every benchmark, one after the other
# make docs       the site, strictly, into site/
# make versions   the oldest and the newest supported versions, and pre-releases, each in an environment of its own
# make release    the release checklist, up to the upload
# Packages and browser are installed side by side.
MAKEFLAGS += -j 2
PYTHON ?= python3
PY := .venv/bin/python
# Compiling all modules of all packages takes a bare machine of CI a minute; the tests compile the few that they import.
PIP := $(PY) -m pip install --disable-pip-version-check $(if $(CI),--no-compile)
# Measured data is not in the repository; a folder of it in or beside the checkout is found.
CONTACTLEARN_DATA ?= $(firstword $(abspath $(wildcard data ../data ../shared/data)))
export CONTACTLEARN_DATA
# Machines that forbid compiled files, as images of containers do, would compile every module again in every process.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo quick browser style test test-all bench docs versions release clean

demo: .venv/installed
	@$(PY) diagnose.py data=mystery data.seed=7
	@echo "next:    source .venv/bin/activate, and open the report above in a browser; contactlearn reveal outputs/mystery/seed_7 prints what was really hidden"

quick: .venv/ready
	$(PY) -m ruff check -q .
	$(PY) -m pytest --quick -n 2 || [ $$? = 5 ] # 5: nothing changed

# The tests open the report in Chromium where there is one; a bare machine that runs CI gets one.
browser:
	@if [ "$$CI" = true ] && [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && ! command -v chromedriver >/dev/null; then \
	  { timeout 120 apt-get -qq update && DEBIAN_FRONTEND=noninteractive timeout 300 apt-get -qq install -y --no-install-recommends chromium chromium-driver; } </dev/null >/dev/null 2>&1 || \
	  echo "Chromium could not be installed: the report is not tested in a browser"; fi

# A worker that is done takes tests from the end of another's; three keep two cores busy while one waits for a process.
SUITE := $(PY) -m pytest -n 3 --dist worksteal

STYLE := $(PY) -m ruff check . && $(PY) -m ruff format --check . && $(PY) -m pyright --pythonpath $(PY)

style: .venv/ready
	$(STYLE)

# Of a test with many cases each commit tries a third, three commits that follow each other all; `make test-all` always.
# What style and a fresh install say comes after the tests, beside which they run: each keeps one core busy for a minute.
test test-all: .venv/ready browser
	@said=$$(mktemp -d); { $(STYLE); } >"$$said/style" 2>&1 & style=$$!; \
	$(PY) tools/versions.py fresh >"$$said/fresh" 2>&1 & fresh=$$!; \
	$(SUITE) $(if $(filter test-all,$@),-m "",--third=$$(git rev-list --count HEAD || echo 0)); tested=$$?; \
	wait $$style; styled=$$?; wait $$fresh; installed=$$?; \
	cat "$$said"/*; rm -r "$$said"; exit $$((tested + styled + installed))

bench: .venv/ready
	$(PIP) -q -c requirements.lock -c benchmarks/requirements.lock -e '.[test,bench]'
	for script in benchmarks/speed/*.py benchmarks/accuracy/*.py benchmarks/sensitivity/*.py; do $(PY) $$script || exit 1; done

docs: .venv/ready
	$(PY) -m sphinx -W --keep-going -q -d .sphinx -c docs . site
	@echo "open     site/index.html"

versions:
	$(PYTHON) tools/versions.py

release: .venv/ready
	$(PY) tools/release.py

# The lock files pin every package; they are made again from pyproject.toml as CONTRIBUTING.md says.
.venv/installed: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "contactlearn needs Python 3.11 or newer; say which with: make PYTHON=python3.12 ..."; exit 1; }
	@echo "First of all, once: the packages of requirements.lock are installed into .venv. PyTorch, NumPy, SciPy, matplotlib and"
	@echo "others are a download of 380 MB with PyTorch for the CPU (some GB where pip takes the one with CUDA), and take a few minutes."
	@echo "The demo simulates its drops: no data are downloaded."
	@$(PYTHON) -m venv .venv
	@$(PIP) -q -c requirements.lock -e .
	@touch $@

.venv/ready: .venv/installed
	@echo "Once: the tools of the tests are installed beside it, among them MuJoCo, scikit-learn, Dash, ruff and pyright, 130 MB more."
	@$(PIP) -q -c requirements.lock -e '.[test]'
	@touch $@

clean:
	rm -rf .venv outputs multirun site .sphinx dist
