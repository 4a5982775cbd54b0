#!/usr/bin/env bash
# A clock that is set back during a run changes no duration: those of the totals are not negative.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
cat > clock.c <<'EOD'
/* The time of day goes back by a day each time that it is asked for. */
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t id, struct timespec* t)
{
    static long days = 0;
    const int rc = (int)syscall(SYS_clock_gettime, id, t);
    if (id == CLOCK_REALTIME)
    {
        t->tv_sec -= 86400*++days;
    }
    return rc;
}
EOD
cc -std=c11 -O2 -Wall -Wextra -Werror -shared -fPIC clock.c -o clock.so
make_case case
surrogate "$jump"
runs env LD_PRELOAD="$work/clock.so" icoFoam
for figure in setup_seconds surrogate_seconds; do
    value=$(entry $figure)
    holds "\"$value\" != \"\" && \"$value\" + 0 >= 0 && \"$value\" + 0 < 600" "$figure:"
done
