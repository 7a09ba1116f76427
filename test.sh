#!/usr/bin/env bash
# Install everything the tests need into .venv (and Oclgrind from Debian, where apt-get is there),
# then run the linters, the type checker, the import contract and the tests. The tests marked slow
# (real scenes at full size, long flights) are run by ./test.sh -m slow. The tests of kernels alone,
# and gibench conform, run on another OpenCL runtime by ./test.sh --opencl NAME, a part of its
# platform's name (Intel, Portable, NVIDIA); docs/conform.md says how to install some.
set -euo pipefail
cd "$(dirname "$0")"

opencl=
if [ "${1:-}" = --opencl ]; then
  opencl=${2:?"--opencl takes a part of a platform's name"}
  shift 2
fi

if [ -z "$opencl" ] && ! command -v oclgrind > /dev/null && command -v apt-get > /dev/null && [ "$(id -u)" = 0 ]; then
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq oclgrind
fi

[ -x .venv/bin/python ] || python3 -m venv .venv
.venv/bin/python -m pip install --quiet --disable-pip-version-check -e '.[dev,truth,browser,project,history,cluster]'
PATH="$PWD/.venv/bin:$PATH"
# Two processes run the tests: threads of NumPy's that wait for work take their time.
export OPENBLAS_NUM_THREADS=1
# Memory that is let go stays with the process: a compiler in it that asks for the same again and
# again else has the system clear pages for a twentieth of the time (glibc; others ignore it).
export MALLOC_TRIM_THRESHOLD_=1000000000 MALLOC_TOP_PAD_=67108864 MALLOC_MMAP_THRESHOLD_=33554432

if [ -n "$opencl" ]; then
  # What pyopencl keeps of a program tells no names of arguments on Intel's runtime; tests go by them.
  export PYOPENCL_CTX="$opencl" PYOPENCL_NO_CACHE=1
  shopt -s globstar
  pytest -n 2 --dist worksteal -m "not slow and not oclgrind" tests/**/test_*kernels*.py \
    tests/techniques/parts tests/rays/test_rays.py "$@"
  gibench conform --time-limit 300
  exit
fi

ruff check .
ruff format --check .
mypy
lint-imports
pytest -n 2 --dist worksteal -m "not slow" "$@"
