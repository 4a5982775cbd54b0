#!/bin/sh
# RUSTC_WRAPPER of ./Alltest: test programs are compiled without optimisation, which takes a seventh of the time. Optimised are the tests of
# packages that compute for long. What is tested from outside (libraries, the command) is as it ships. Cargo keeps no account of a wrapper,
# so that tests that are compiled already stay as they are. Nor have test programs lines for a backtrace, which are two thirds of their 70 MB each:
# a panic says its own.
case " $* " in
    # The second two: programs of their own that run on several ranks
    *" --test "* | *tests/mpi_*.rs\ * | *tests/odds/main.rs\ *)
        set -- "$@" -C debuginfo=0 -C strip=debuginfo
        case $CARGO_PKG_NAME in
            m4gn-engine | m4gn-modes | m4gn-averages) ;;
            *) set -- "$@" -C opt-level=0 ;;
        esac
        ;;
esac
exec "$@"
