#!/bin/sh
# Cargo starts this in place of rustc for the workspace's own crates (RUSTC_WORKSPACE_WRAPPER), so that they count which of
# their edges are executed and which values are compared. What they depend on is compiled as ever, and not twice.
exec "$@" -Cpasses=sancov-module -Ccodegen-units=1 \
    -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
    -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares
