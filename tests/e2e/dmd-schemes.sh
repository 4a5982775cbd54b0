#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and time schemes that look at more than the present state: backward and CrankNicolson, whose old
# levels and rates are states of the fit; pimpleFoam with outer correctors; what is refused.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 4 deltaT 0.005 writeInterval 2
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
# What pimpleFoam needs besides; three outer correctors
laminar
sed -i 's/^PISO/PIMPLE { nCorrectors 2; nOuterCorrectors 3; }\nPISO/; s/^    U$/    "(U|UFinal)"/' system/fvSolution

while read -r solver scheme; do
    ddt_scheme "$scheme"
    control application "$solver"
    plain 2 4
    ride 'mode replace; surrogates (dmd); timeStart 2; dmd { snapshotInterval 0.05; minSnapshots 24; jumpTolerance 0.1; fitTolerance 0.1; }'
    replaces 0.2 "$solver, $scheme"
    # Half of the run changes it by a quarter and more
    close_to ../plain 0.15 4/U
done <<'EOD'
pimpleFoam Euler
icoFoam backward
icoFoam CrankNicolson 0.9
EOD
# What CrankNicolson keeps
expect_log 'the dmd surrogate advances U, p, phi and, with them, ddt0(U), ddtCorrDdt0('

ddt_scheme steadyState
clean_case
refused 'does not handle the time scheme steadyState of ddtSchemes' icoFoam
