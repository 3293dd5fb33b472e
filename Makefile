# make demo: both experiments, with pictures. make test: all tests, Python's too. Both do all set-up on a fresh Debian 12 with Rust.
# make python: the Python package's wheel in dist/, and environments with it.
.PHONY: demo test python setup
.NOTPARALLEL:

demo: setup
	@scripts/demo

test:
	@scripts/setup python3-venv
	@scripts/test
	@scripts/python test

python:
	@scripts/setup python3-venv
	@scripts/python

setup:
	@scripts/setup
