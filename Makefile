# Every target calls ./run, which also works where there is no make: sh run TASK.
.DEFAULT_GOAL := help
.PHONY: help demo test check bench native bundle docs mutants setup clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-8s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo:  ## set up what is missing, then run the demo (ARGS="--volume FILE" go to it)
	@sh run demo $(ARGS)

test:  ## set up what is missing, then run all tests (ARGS="-k warp" go to pytest)
	@sh run test $(ARGS)

check:  ## set up what is missing, then lint, check types and the direction of imports, of Python and JavaScript
	@sh run check

bench:  ## set up what is missing, then compare the speed with other packages (ARGS="--size 128")
	@sh run bench $(ARGS)

native:  ## compile the loops over voxels and centres, where they have changed (ARGS="linux-arm64" for that platform)
	@sh run native $(ARGS)

bundle:  ## bundle the JavaScript of the widgets, where it has changed (ARGS="--debug" for a debugger)
	@sh run bundle $(ARGS)

docs:  ## build the documentation into docs/_build/html (ARGS="-D nb_execution_mode=off" runs no notebooks)
	@sh run docs $(ARGS)

mutants:  ## put small faults into a copy of the code and see whether the tests notice (ARGS="--random 30")
	@sh run mutants $(ARGS)

setup:  ## set up only (ARGS="notebook formats" are extras)
	@sh run setup $(ARGS)

clean:  ## remove .venv and everything the tools have left behind
	@sh run clean
