#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and time schemes that look at more than the present state: backward and CrankNicolson, whose old
# levels and rates are states of the fit; pimpleFoam with outer correctors; what is refused.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 4;/; s/^deltaT .*/deltaT 0.005;/; s/^writeInterval .*/writeInterval 2;/' system/controlDict
sed -i 's/tolerance  *1e-10/tolerance 1e-7/; s/relTol  *0;/relTol 0.05;/' system/fvSolution

# What pimpleFoam needs besides; three outer correctors
echo "$(header x) simulationType laminar; transportModel Newtonian; nu 1e-3;" | tee constant/turbulenceProperties > constant/transportProperties
sed -i 's/div(phi,U).*/div(phi,U) Gauss linear; div((nuEff*dev2(T(grad(U))))) Gauss linear;/' system/fvSchemes
sed -i 's/^PISO/PIMPLE { nCorrectors 2; nOuterCorrectors 3; }\nPISO/; s/^    U$/    "(U|UFinal)"/' system/fvSolution

while read -r solver scheme; do
    sed -i "/ddtSchemes/,/}/s/default .*;/default $scheme;/" system/fvSchemes
    plain "$solver" 2 4
    function_object m4gnSurrogate 'mode replace; surrogates (dmd); timeStart 2; dmd { snapshotInterval 0.05; minSnapshots 24; jumpTolerance 0.1; fitTolerance 0.1; }'
    runs "$solver"
    replaces 0.2 "$solver, $scheme"
    # Half of the run changes it by a quarter and more
    below "$(difference ../plain/4/U 4/U)" 0.15 "$solver, $scheme: largest error of U"
    cp log.run ../cn.log
done <<'EOD'
pimpleFoam Euler
icoFoam backward
icoFoam CrankNicolson 0.9
EOD
grep -q 'the dmd surrogate advances U, p, phi and, with them, ddt0(U), ddtCorrDdt0(' ../cn.log || fail "what CrankNicolson keeps is not handed over"

sed -i "/ddtSchemes/,/}/s/default .*;/default steadyState;/" system/fvSchemes
clean_case
refused 'does not handle the time scheme steadyState of ddtSchemes' icoFoam
