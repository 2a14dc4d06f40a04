PYTHON ?= python

SECONDS ?= 60

.PHONY: kernels test lint docs man site bench golden samples slow fuzz

test:
	$(PYTHON) -m pytest

slow:
	$(PYTHON) -m pytest -m slow

fuzz:
	$(PYTHON) -m pip install -q -e '.[fuzz]'
	$(PYTHON) fuzz/run.py $(SECONDS)

lint:
	ruff check .
	ruff format --check .
	mypy
	lint-imports

site:
	$(PYTHON) -m mkdocs build --strict

man:
	$(PYTHON) docs/manpages.py build/man

docs:
	$(PYTHON) docs/generate.py

kernels:
	$(PYTHON) sample_logs/kernels.py

samples:
	$(PYTHON) sample_logs/make.py samples

golden:
	$(PYTHON) sample_logs/make.py golden

bench:
	$(PYTHON) benchmarks/slam_real.py
	$(PYTHON) benchmarks/speed.py
