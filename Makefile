# make demo   from a picture of a chair to out/chair.glb        make test   all tests
# make lint   ruff and pyright                                  make bench  the numbers in docs/results.md
# Each installs what is missing first, into .venv; a second call is instant.
#   EXTRAS=app,dev     which optional parts to install          PYTHON=/path/to/python3.11
SHELL := /bin/bash
VENV ?= .venv
EXTRAS ?= infinigen,app,usd,train,cluster,words,foundation,dev
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := $(VENV)/bin
comma := ,
INSTALLED := $(VENV)/.installed-$(subst $(comma),-,$(EXTRAS))

# Blender's module and OpenGL without a window link to these; scikit-image and meshoptimizer are compiled here.
# Tests of the web app drive Chromium.
PACKAGES := libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri libxrender1 libxi6 libxkbcommon0 libsm6 libice6 libxxf86vm1 \
            libxfixes3 g++
ifneq ($(filter dev,$(subst $(comma), ,$(EXTRAS))),)
PACKAGES += chromium
endif
HEADERS := import os, sysconfig; raise SystemExit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))
SUPPORTED := import sys; raise SystemExit(sys.version_info < (3, 11))

.PHONY: help install system python demo test lint format bench clean

help:
	@sed -n 's/^# \{0,1\}//p' Makefile | head -4

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@$(MAKE) --no-print-directory python system
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -c constraints.txt -e '.[$(EXTRAS)]'
	@touch $@

python:
	@$(PYTHON) -c '$(SUPPORTED)' || { \
	  echo "Python 3.11 is needed (Blender 4.2's module exists for no other), got '$(PYTHON)'. Install it:" \
	       "apt-get install python3.11-venv, or name yours: make install PYTHON=/path/to/python3.11" >&2; exit 1; }

# Debian and Ubuntu only; elsewhere `dipcg doctor` says what is missing.
system:
	@command -v dpkg-query >/dev/null || exit 0; \
	for package in $(PACKAGES); do \
	  dpkg-query -W -f '$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$package"; \
	done; \
	$(PYTHON) -c '$(HEADERS)' || missing="$$missing python3-dev"; \
	$(PYTHON) -c 'import ensurepip' 2>/dev/null || missing="$$missing python3-venv"; \
	[ -n "$$missing" ] || exit 0; \
	if [ "$$(id -u)" = 0 ]; then \
	  apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $$missing; \
	else echo "These system packages are missing; install them with: sudo apt-get install -y$$missing" >&2; fi

demo: install
	@mkdir -p out
	$(BIN)/dipcg estimate examples/images/chair.png -g chair -o out/chair.glb \
	  --params-out out/chair.json --preview out/chair.png
	@echo "Wrote out/chair.glb (open it in Blender), out/chair.json (its parameters) and out/chair.png (photo and result)."

test: install
	$(BIN)/python -m pytest -n 2 $(ARGS)

lint: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python

format: install
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: install
	$(BIN)/python -m benchmarks $(ARGS)

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache build dist
