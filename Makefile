# make demo   from a picture of a chair to out/chair.glb   make audit        published security holes of dependencies
# make test   all tests                                    make pins         constraints.txt from the environment
# make fast   no Blender, browser or training              make wheel-check  builds the package and tries it by itself
# make lint   Ruff and Pyright                             make image        a Docker image of the web app
# make bench  the numbers in docs/results.md               make image-check  runs the image's steps without Docker
# make addon  dipcg.zip, the add-on for Blender
# make checkpoints   trains all that ships, for hours at the lowest priority; NAMES='chair table' trains these, in order
# Each installs what is missing first, into .venv; a second call is instant. Options, as in `make demo TORCH=cpu`:
#   EXTRAS=app,dev              the optional parts to install
#   PYTHON=/path/to/python3.11  which Python; by default 3.11 of this machine, or else one that uv downloads
#   TORCH=cpu|cu128|auto        which build of torch, from PyTorch's own index. With `auto`, the default, uv takes the
#                               small one for the CPU unless there is an NVIDIA driver. TORCH= takes PyPI's, which on
#                               Linux is the large one for CUDA; it is the default in CI and where pip has sources
#                               of its own.
#   CONSTRAINTS=/dev/null       the newest versions instead of those in constraints.txt
# Without make: `uv pip install -c constraints.txt -e '.[infinigen,app]'` in an environment of Python 3.11, or with
# pip `pip install --no-deps -r constraints.txt -e .`, which installs the same versions, of all optional parts. Other
# calls of pip cannot go past Infinigen's limits (see pyproject.toml): they install old versions with published
# security holes and compile one of them for many minutes.
SHELL := /bin/bash
VENV ?= .venv
EXTRAS ?= infinigen,app,heic,usd,train,cluster,words,foundation,dev
PYTHON ?= 3.11
TORCH ?= $(if $(CI)$(PIP_FIND_LINKS)$(PIP_INDEX_URL),,auto)
CONSTRAINTS ?= constraints.txt
BIN := $(VENV)/bin
comma := ,
space := $() $()
INSTALLED := $(VENV)/.installed-$(subst $(comma),-,$(EXTRAS))

# uv reads none of pip's settings, so it is given those in the environment. Where Python may not store compiled modules,
# each start would compile torch again, so uv does it once.
UV_SETTINGS := $(if $(PIP_CERT),SSL_CERT_FILE='$(PIP_CERT)') \
               $(if $(PIP_INDEX_URL),UV_DEFAULT_INDEX='$(PIP_INDEX_URL)') \
               $(if $(PIP_EXTRA_INDEX_URL),UV_INDEX='$(PIP_EXTRA_INDEX_URL)') \
               $(if $(PIP_FIND_LINKS),UV_FIND_LINKS='$(subst $(space),$(comma),$(strip $(PIP_FIND_LINKS)))')
UV_PROGRAM := $(or $(shell command -v uv),.uv/bin/uv)
UV := $(strip $(UV_SETTINGS) $(UV_PROGRAM))
UV_INSTALL := $(UV) pip install -c $(CONSTRAINTS) $(if $(filter /dev/null,$(CONSTRAINTS)),--upgrade) \
              $(if $(TORCH),--torch-backend $(TORCH)) $(if $(PYTHONDONTWRITEBYTECODE),--compile-bytecode)

# OpenCV, Blender's module and OpenGL without a window link to these libraries; meshoptimizer is compiled; tests of the
# app drive a browser.
CHROMIUM := $(or $(shell command -v chromium),$(shell command -v chromium-browser),$(shell command -v google-chrome))
PACKAGES := libglib2.0-0 libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri libxrender1 libxi6 libxkbcommon0 libsm6 libice6 \
            libxxf86vm1 libxfixes3 g++ $(if $(filter dev,$(subst $(comma), ,$(EXTRAS))),$(if $(CHROMIUM),,chromium))
MACHINE_PYTHON := $(or $(shell command -v python3.11),$(shell command -v python3),python3)
HEADERS := import os, sysconfig; raise SystemExit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))

.PHONY: help install system environment demo test fast lint format bench checkpoints addon audit pins wheel-check image image-check newer-blender other-python clean

help:
	@sed -n 's/^# \{0,1\}//p;/^SHELL/q' Makefile

install: $(INSTALLED)

$(INSTALLED): pyproject.toml $(CONSTRAINTS)
	@$(MAKE) --no-print-directory system
	@$(MAKE) --no-print-directory environment
	$(UV_INSTALL) --python $(BIN)/python -e '.[$(EXTRAS)]'
	@touch $@

environment: $(UV_PROGRAM)
	@[ -x $(BIN)/python ] || $(UV) venv --quiet --seed --python '$(PYTHON)' $(VENV) || { \
	  echo "Python 3.11 is needed (Blender 4.2's module exists for no other). Install it:" \
	       "apt-get install python3.11-venv, or name yours: make install PYTHON=/path/to/python3.11" >&2; exit 1; }

.uv/bin/uv:
	@$(MACHINE_PYTHON) -m venv .uv
	@.uv/bin/python -m pip install --quiet -c $(CONSTRAINTS) uv

# Debian and Ubuntu only; elsewhere `dipcg doctor` says what is missing. Newer releases add t64 to some names.
system:
	@command -v dpkg-query >/dev/null || exit 0; \
	for package in $(PACKAGES); do \
	  dpkg-query -W -f '$${Status}' $$package $${package}t64 2>/dev/null | grep -q 'ok installed' || \
	    missing="$$missing $$package"; \
	done; \
	$(MACHINE_PYTHON) -c '$(HEADERS)' || missing="$$missing $(notdir $(MACHINE_PYTHON))-dev"; \
	$(MACHINE_PYTHON) -c 'import ensurepip' 2>/dev/null || missing="$$missing $(notdir $(MACHINE_PYTHON))-venv"; \
	[ -n "$$missing" ] || exit 0; \
	if [ "$$(id -u)" = 0 ]; then \
	  apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $$missing; \
	else echo "These system packages are missing; install them with: sudo apt-get install -y$$missing" >&2; fi

# What users need, so that trying it takes no browser and no cluster.
demo:
	@$(MAKE) --no-print-directory install EXTRAS=infinigen,app,usd,words
	@mkdir -p out
	$(BIN)/dipcg estimate examples/images/chair.png -g chair -o out/chair.glb \
	  --params-out out/chair.json --preview out/chair.png
	@echo "Wrote out/chair.glb (open it in Blender), out/chair.json (its parameters) and out/chair.png (photo and result)."

test: install
	$(BIN)/python -m pytest -n 2 $(ARGS)

fast: install
	$(BIN)/python -m pytest -n 2 -m 'not blender and not browser and not slow' $(ARGS)

# Blender 4.5 in an environment of its own, for the tests of `dipcg generators add --blender`.
newer-blender: $(UV_PROGRAM)
	@[ -x .newer-blender/bin/python ] || $(UV) venv --quiet --python '$(PYTHON)' .newer-blender
	$(UV) pip install --quiet --python .newer-blender/bin/python 'bpy==4.5.*' numpy

# dipcg without Infinigen on another Python: its newest packages, and the tests of generators and of building.
other-python: OTHER := 3.13
other-python: $(UV_PROGRAM)
	@[ -x .other-python/bin/python ] || $(UV) venv --quiet --python '$(OTHER)' .other-python
	$(UV) pip install --quiet $(if $(TORCH),--torch-backend $(TORCH)) --python .other-python/bin/python \
	  . beartype hypothesis pytest pytest-xdist
	.other-python/bin/python -m pytest -n 2 -m 'not blender and not browser and not slow' \
	  tests/importing tests/workers tests/generators tests/test_space.py tests/test_mesh.py $(ARGS)

lint: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --pythonpath $(BIN)/python

format: install
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: install
	$(BIN)/python -m benchmarks $(ARGS)

addon: install
	$(BIN)/dipcg blender-addon -o dipcg.zip

checkpoints: install
	nice -n 19 $(BIN)/python -m benchmarks.marathon $(NAMES)
	nice -n 19 $(BIN)/python -m benchmarks.ship $(NAMES)

# pip-audit gets an environment of its own. Without --strict it passes where its database cannot be reached.
audit: $(UV_PROGRAM)
	$(UV) tool run pip-audit --strict --no-deps --disable-pip -r constraints.txt

# uv may be no part of the environment. A build of torch such as 2.13.0+cpu is the same release as 2.13.0.
pins: install
	{ $(UV) pip freeze --quiet --exclude-editable --python $(BIN)/python; \
	  $(UV) --version | awk '{print $$1 "==" $$2}'; } | \
	  sed 's/+.*//' | grep -vE '^(pip|wheel)==' | LC_ALL=C sort -fu > constraints.new
	{ head -1 constraints.txt; cat constraints.new; } > constraints.both
	mv constraints.both constraints.txt && rm constraints.new

# In a folder of its own, where the package is all there is of the repository.
wheel-check: $(UV_PROGRAM)
	rm -rf dist && $(UV) build --quiet
	folder=$$(mktemp -d) && trap "rm -rf $$folder" EXIT && \
	$(UV) venv --quiet --python '$(PYTHON)' $$folder/env && \
	$(UV_INSTALL) --quiet --python $$folder/env/bin/python "$$(echo dist/*.whl)[infinigen]" && \
	cp examples/images/chair.png $$folder && cd $$folder && env/bin/dipcg estimate chair.png -g chair -o chair.glb && \
	ls -l chair.glb

image:
	docker build -t dipcg .

# The image's files, RUN and CMD in a folder, without Docker and without changes to the system.
image-check: PORT := 17860
image-check:
	folder=$$(mktemp -d) && trap "rm -rf $$folder" EXIT && \
	tar -c --anchored --exclude-from=.dockerignore $$(ls -A) | tar -x -C $$folder && cd $$folder && \
	sed ':a;/\\$$/{N;s/\\\n//;ta}' Dockerfile | sed -n 's/^RUN \(--[^ ]* *\)*//p' | \
	  bash -euxc 'apt-get() { :; }; useradd() { :; }; export -f apt-get; source /dev/stdin' && \
	{ PATH=.venv/bin:$$PATH $$(sed -n 's/^CMD //p' Dockerfile | tr -d '[],"') --port $(PORT) & } && \
	timeout 60 bash -c 'until (: < /dev/tcp/127.0.0.1/$(PORT)) 2>/dev/null; do sleep 1; done'; \
	status=$$?; kill %1; exit $$status

clean:
	rm -rf $(VENV) .uv .newer-blender .other-python .pytest_cache .ruff_cache build dist
