# Every task of the project. `make demo` and `make test` set up everything they need in .venv.
# Cargo is asked about the whole workspace wherever it can be: which features of a library are on depends on who else is asked
# for, and other features are another build of it and of all that stands on it.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
TOOLS  := $(VENV)/.tools
SOURCES := Cargo.toml Cargo.lock pyproject.toml $(shell find rust build_backend -name '*.rs' -o -name '*.toml' -o -name 'dynid_build.py')
DEMO   ?= demo
SECONDS_EACH ?= 60
SEED   ?= 1
MUTANTS ?= 60
ARMS ?= 20
JOBS ?= 1
ARCHS  ?= x86_64 aarch64
EVERY  := test,check,docs,physical,paper
ALL    := [$(EVERY),wheels]
# EARLY=1: what tests, checks and wheels take comes together with the package, because each further installation takes its time.
EARLY  ?=

.DEFAULT_GOAL := help
.PHONY: help demo test test-rust test-python check docs workflows bench arm wheels clean-venv sbom exam loop fuzz fuzz-readers mutants mutation-tools trust audit paper clean toolchain

help: ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

demo: $(STAMP) ## simulate an arm, identify it, print errors per joint and where the report is
	@rm -rf $(DEMO)
	$(BIN)/dynid simulate -o $(DEMO) --runs 5
	$(BIN)/dynid identify $(DEMO)/robot.urdf $(DEMO)/run_0.parquet $(DEMO)/run_1.parquet $(DEMO)/run_2.parquet $(DEMO)/run_3.parquet \
	  --test $(DEMO)/run_4.parquet -o $(DEMO)/result

test: test-rust test-python ## all tests

test-rust: toolchain
	cargo test --release --workspace --quiet

test-python: $(STAMP) $(TOOLS)
	$(BIN)/python tests/side_by_side.py

check: $(STAMP) $(TOOLS) workflows ## format, lints, types, documentation, workflows
	cargo fmt --check
	cargo clippy --release --workspace --all-targets --quiet -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --quiet
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(STAMP) $(TOOLS) ## the site, into build/docs; runs the tutorial and the notebooks, and takes every warning for an error
	$(BIN)/python -m sphinx -b html -W --keep-going -n -q docs build/docs
	@echo build/docs/index.html

# actionlint, the third eye, comes as a download of its own: the workflow runs it, and this does where it is installed.
workflows: $(TOOLS)
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-forms $(filter-out %/config.yml,$(wildcard .github/ISSUE_TEMPLATE/*.yml))
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/zizmor --offline --no-progress --quiet --min-severity medium .github/workflows
	if command -v actionlint >/dev/null; then actionlint; fi

bench: $(STAMP) ## every figure side by side with its peer; writes docs/measured/benchmarks.md and seconds.md, and a short scale.md into build/
	$(BIN)/python -m pip install --quiet --editable '.[bench]'
	$(BIN)/python benches/main.py
	$(BIN)/python benches/where.py
	$(BIN)/python benches/loops.py
	$(BIN)/python benches/em.py
	$(BIN)/python benches/scale.py --page build/scale.md

# NEON is part of every 64-bit ARM processor, so its kernels are the baseline ones there.
arm: export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER = aarch64-linux-gnu-gcc
arm: export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER = qemu-aarch64 -L /usr/aarch64-linux-gnu
arm: toolchain ## the formulas' tests built for 64-bit ARM and run by an emulator (qemu-user, gcc-aarch64-linux-gnu)
	rustup target add aarch64-unknown-linux-gnu
	cargo test --release --target aarch64-unknown-linux-gnu -p dynid-core --quiet

# The first wheel is built from the source archive, which so is seen to hold all that it takes. zig links for the C library
# of manylinux_2_28, whatever this machine has, and for other processors.
wheels: export CARGO_TARGET_DIR ?= $(CURDIR)/target
wheels: export PATH := $(CURDIR)/$(BIN):$(PATH)
ifdef QUICK
wheels: export CARGO_PROFILE_WHEEL_LTO = off
wheels: export CARGO_PROFILE_WHEEL_CODEGEN_UNITS = 16
wheels: export CARGO_PROFILE_WHEEL_OPT_LEVEL = 1
endif
wheels: $(STAMP) $(TOOLS) ## source archive and wheels for Linux on x86_64 and aarch64 into dist/ (ARCHS=x86_64: that alone; QUICK=1: larger and slower)
	@grep -q every $(STAMP) || $(BIN)/python -m pip install --quiet --editable '.[wheels]'
	rm -rf dist
	rustup target add $(ARCHS:%=%-unknown-linux-gnu)
	from=""; for arch in $(ARCHS); do \
	  $(BIN)/python -m build $$from --no-isolation -o dist . \
	    -C build-args="--zig --target $$arch-unknown-linux-gnu --compatibility manylinux_2_28" || exit 1; from=--wheel; done
	$(if $(QUICK),,$(BIN)/python build_backend/smaller.py dist/*.whl)
	$(BIN)/python tests/wheels.py $(if $(QUICK),--any-size) dist/*.whl

clean-venv: $(STAMP) $(TOOLS) ## install the wheel in dist/ into a new venv and take the first steps there
	$(BIN)/python tests/clean_venv.py dist

# The wheel carries that of the module (dist-info/sboms); these are the binary's and the Python libraries'.
sbom: $(STAMP) ## bills of materials (CycloneDX) into build/sbom
	$(BIN)/python -m pip install --quiet --editable '.[sbom]'
	command -v cargo-cyclonedx >/dev/null || cargo install --locked cargo-cyclonedx
	mkdir -p build/sbom
	cargo cyclonedx --format json --manifest-path rust/dynid-estimator/Cargo.toml
	mv rust/dynid-estimator/dynid-estimator.cdx.json build/sbom/
	find rust -name '*.cdx.json' -delete
	$(BIN)/cyclonedx-py environment --output-reproducible --output-file build/sbom/python.cdx.json $(BIN)/python

exam: $(STAMP) $(TOOLS) ## diagnose 200 fresh cases of an examiner that shares nothing with the product; writes docs/measured/exam.md
	$(BIN)/python tests/exam/run.py --page docs/measured/exam.md

loop: $(STAMP) $(TOOLS) ## drawn arms that nobody knows: excite, record, diagnose, excite what is open, until only noise is left (SEED=1 ARMS=20: hours)
	$(BIN)/python tests/campaigns/loop.py --seed $(SEED) --arms $(ARMS) --jobs $(JOBS) $(if $(PAGE),--page $(PAGE)) $(if $(KEEP),--keep $(KEEP))

fuzz: toolchain ## look for inputs that crash, hang or swallow memory, 60 s per way in (SECONDS_EACH=600: longer; needs a C++ compiler)
	$(PYTHON) fuzz/run.py --seconds $(SECONDS_EACH)

fuzz-readers: $(STAMP) ## the same for readers that are Python (tables, JSON lines, dynid.toml), by Atheris
	$(BIN)/python -m pip install --quiet --editable '.[fuzz]'
	$(BIN)/python fuzz/run.py --seconds $(SECONDS_EACH) --target table --target json_lines --target config

mutants: mutation-tools ## small changes to Rust and Python, drawn from a seed: does a test fail? (SEED=1 MUTANTS=60 of each: hours)
	$(BIN)/python tests/campaigns/mutants.py --seed $(SEED) --rust $(MUTANTS) --python $(MUTANTS)

mutation-tools: $(STAMP) $(TOOLS)
	$(BIN)/python -m pip install --quiet --editable '.[mutants]'
	command -v cargo-mutants >/dev/null || cargo install --locked cargo-mutants

trust: mutation-tools ## run every campaign of docs/measured/trust.md, which takes hours, and write its figures
	$(BIN)/python tests/campaigns/page.py

audit: $(STAMP) ## advisories, licences and sources of everything we depend on (needs the network and cargo-deny)
	cargo deny --workspace check
	$(BIN)/python -m pip install --quiet pip-audit
	$(BIN)/python -m pip_audit --skip-editable

paper: $(STAMP) ## repeat the source paper's experiment and write docs/measured/paper.md with its figures
	$(BIN)/python -m pip install --quiet --editable '.[paper]'
	$(BIN)/python examples/paper/main.py --data "$$($(BIN)/python tests/helpers/data.py)"

clean: ## remove everything that was built
	rm -rf target dist build fuzz/target fuzz/work $(VENV) $(DEMO) rust/dynid-py/dynid_rs.data python/dynid_rs/*.so

# One sentence for what is missing, and how to get it.
toolchain:
	@command -v cargo >/dev/null 2>&1 || { echo "error: Rust (cargo) is missing; get it with https://rustup.rs, then run make again" >&2; exit 1; }
	@command -v $(PYTHON) >/dev/null 2>&1 || { echo "error: $(PYTHON) is missing; install Python 3.11 or newer, or name yours with make PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "error: $(PYTHON) is older than 3.11; install a newer Python, or name yours with make PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "error: $(PYTHON) has no venv module; install it (Debian: apt install python3-venv)" >&2; exit 1; }

$(VENV)/bin/python: | toolchain
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

# Editable: Python files are used where they stand; a change in Rust builds again.
$(STAMP): $(SOURCES) | $(VENV)/bin/python
	@echo "building dynid-rs (the first time takes some minutes)"
	$(BIN)/python -m pip install --quiet --editable '.$(if $(EARLY),$(ALL))'
	$(BIN)/python -m compileall -q python/dynid_rs # as an installed package is: else every process does, where none may write
	@echo '$(if $(EARLY),every tool)' >$@

$(TOOLS): pyproject.toml $(STAMP)
	@grep -q every $(STAMP) || $(BIN)/python -m pip install --quiet --editable '.[$(EVERY)]'
	@touch $@
