#!/usr/bin/env bash
# Install everything the tests need into .venv (and Oclgrind from Debian, where apt-get is there),
# then run the linters, the type checker, the import contract and the tests. The tests marked slow
# (real scenes at full size, long flights) are run by ./test.sh -m slow.
set -euo pipefail
cd "$(dirname "$0")"

if ! command -v oclgrind > /dev/null && command -v apt-get > /dev/null && [ "$(id -u)" = 0 ]; then
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq oclgrind
fi

[ -x .venv/bin/python ] || python3 -m venv .venv
.venv/bin/python -m pip install --quiet --disable-pip-version-check -e '.[dev,truth,browser,project,history]'
PATH="$PWD/.venv/bin:$PATH"

ruff check .
ruff format --check .
mypy
lint-imports
pytest -n 2 --dist worksteal -m "not slow" "$@"
