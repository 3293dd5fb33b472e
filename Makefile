# make demo: both experiments, with pictures. make test: all tests. Both do all set-up on a fresh Debian 12 with Rust.
.PHONY: demo test setup
.NOTPARALLEL:

demo: setup
	@scripts/demo

test: setup
	@scripts/test

setup:
	@scripts/setup
