#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd): no model; against the plain run, with means beside it, on two ranks, refused where it cannot be. verify.sh and restart.sh carry such runs
# on.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 4 writeInterval 0.25 writeFormat binary
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
# Files of a time, 4, as text
ascii() {
    control writeFormat ascii
    runs foamFormatConvert -time "${1:-4}" -noFunctionObjects
    control writeFormat binary
}
largest() { awk '/^time step continuity errors/ { sub(",", "", $9); if ($9 > m) m = $9 } END { print m + 0 }' "$1"; }

plain 1 2 4
plain=$(largest log.run)

dmd() { echo "mode replace; surrogates (dmd); timeStart 2; dmd { snapshotInterval 0.05; minSnapshots 24; fitTolerance 0.025; $* }"; }
beside="$(drag forces) averages { type m4gnAverages; libs (m4gnAverages); quantities { Cd { functionObject forces; result Cd; relative 0.01; } } }"
# Nothing is jumped before 2 s: from 1 s on, with the states of a first fit soon behind 2 s, it is the plain run
from_plain() { clean_case && cp -r ../plain/1 . && control startTime 1; }
from_plain
surrogate "$(dmd 'writeModes 1;')"
solve
unset beside
# A pressure without an equation in time is carried: the noise of its tolerance is none of the fit's
expect_log '^m4gn: the dmd surrogate advances U, p, phi'
decided "a fit of U alone" "list(of('fit', decision='used')[0]['errors']) == ['U']"
# Its modes are data, a table and a line of the log
decided "rows of modes.dat" "sum(len(d['modes']) for d in of('fit', decision='used')) == $(grep -vc '^#' postProcessing/test/1/modes.dat)"
decided "shares of the energy" "not [d for d in of('fit', decision='used') if abs(sum(m['energy'] for m in d['modes']) - 1) > 1e-9]"
expect_log 'it is used: .*growth -*[0-9.e-]* 1/s'
replaces 0.2 icoFoam
# Strides weigh in a mean as the time that they stand for, and the share that came from the surrogate is told
told=$(calc "$(figure . Cd surrogate_share 1)*(4 - $(figure . Cd transient_end 1))")
holds "($told - $(entry replaced_time))^2 < 1e-4" "s from a surrogate, by the share that is told and by its own account: $told, $(entry replaced_time);"
expect_log 'm4gn: Cd .* % of the time from a surrogate'
jumps=$(grep -vc '^#' postProcessing/test/1/surrogate.dat)
# What is handed back is as free of divergence as the solver's own, and so is the solver's next step
below "$(largest log.run)" "$(calc "1.5*$plain")" "largest continuity error"
keep whole 3.25 4
# What does not oscillate is the flow with its largest wave
found=$(ls -d [0-9]*/'mode1Imaginary(U)' | sort -n | tail -n 1)
ascii "${found%/*}"
python3 - "${found%/*}" <<'EOD' || fail "the largest wave is little of the flow"
import re, sys
def field(name):
    text = open(f"{sys.argv[1]}/{name}").read()
    inner = text[text.index("internalField"):text.index("boundaryField")]
    return [float(x) for values in re.findall(r"\(([^()]+)\)", inner) for x in values.split()]
u, mean, real, rms = map(field, ("U", "modeMean(U)", "mode1Real(U)", "modeRms(U)"))
square = lambda values: sum(x*x for x in values)
with_wave, alone = square([a - b - c for a, b, c in zip(u, mean, real)]), square([a - b for a, b in zip(u, mean)])
print(f"largest wave: {with_wave/alone:.3g} of what the flow varies by are left")
assert len(u) == len(real) > 1000 and with_wave < 0.3*alone
# A wake travels: over all cells it is at each time as large as over its period
assert 0.4*alone < square(rms) < 4*alone, square(rms)/alone
EOD
# Over what the wake changes
for folder in plain/4 plain/2 whole/4 whole/3.25; do
    rm -rf 4 && cp -r ../$folder 4 && ascii
    cp 4/U "../U.${folder/\//.}"
done
hold=$(difference ../U.plain.4 ../U.plain.2)
below "$(difference ../U.plain.4 ../U.whole.4)" "$(calc "0.2*$hold")" "largest error of U after $jumps jumps"

# Two ranks, behind the first jump, decomposed as those of the tutorial of a cylinder, which leaves them out where a test has one core
from_plain
cp "$M4GN_HOME/openfoam/tutorials/cylinder/system/decomposeParDict" system
control endTime 3.25
solve 2
expect_log '^m4gn: jumped'
runs reconstructPar -latestTime
ascii 3.25
below "$(difference ../U.whole.3.25 3.25/U)" 1e-2 "U on two ranks"

# What cannot be
expect_error 'expected one of snapshotInterval' "$(dmd 'snapshotIntervall 0.05;')"
