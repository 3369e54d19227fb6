# Every target sets the machine up first; on a machine that is set up this takes a moment.
PROFILE ?= quick
PYTHON ?= python3

.DEFAULT_GOAL := help
.PHONY: help setup report gallery test hosts mutants bench calibrate doctor lint clean

help:  ## Show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-9s %s\n", $$1, $$2 }' Makefile

setup:  ## Make .venv, with every package at its locked version, and check the native libraries
	@$(PYTHON) -I harness/machine/bootstrap.py

report: setup  ## Render, measure and set reports/out/report.pdf; PROFILE=quick (default) or full
	.venv/bin/harness report --profile $(PROFILE)

gallery: setup  ## Render the handout's two pictures, 1024 x 1024, with all their samples; may be interrupted
	.venv/bin/harness gallery

test: setup  ## Run every unit test and every tolerance gate
	.venv/bin/pytest -n 2 --dist worksteal

hosts: setup  ## Run exported shaders in wgpu-shadertoy and Chromium, the report's page too; they must be there, and mesa-vulkan-drivers
	.venv/bin/uv pip install --quiet --python .venv/bin/python --no-build-isolation --editable '.[shadertoy]'
	.venv/bin/pytest tests/foreign

mutants: setup  ## Seed one-line bugs into the shader and show which gates notice them
	.venv/bin/harness mutants

bench: setup  ## Compare the speed of the GLSL tracer and Mitsuba in one run
	.venv/bin/harness bench

calibrate: setup  ## Measure how often the verdicts err, for the report
	.venv/bin/harness calibrate

doctor: setup  ## Show what this machine has and lacks
	.venv/bin/harness doctor

lint: setup  ## Run the linter and the type checker
	.venv/bin/ruff check
	.venv/bin/mypy

clean:  ## Remove .venv, caches and everything under reports/out
	rm -rf .venv reports/out .pytest_cache .ruff_cache .mypy_cache
	find harness tests -name __pycache__ -prune -exec rm -rf {} +
