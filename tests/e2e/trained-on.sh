#!/usr/bin/env bash
# A model that says what it was trained on, in a case that is like it and in one that is not.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 0.03;/' system/controlDict

# model FILE TRAINED_ON: the small model with this record in its description
model() {
    python3 - "$small_model" "$1" "$2" <<'PYTHON'
import json, struct, sys
data = open(sys.argv[1], "rb").read()
n = struct.unpack("<Q", data[:8])[0]
header = json.loads(data[8:8 + n])
spec = json.loads(header["__metadata__"]["m4gn"])
spec["trained_on"] = json.loads(sys.argv[3])
header["__metadata__"]["m4gn"] = json.dumps(spec)
text = json.dumps(header).encode()
text += b" " * (-len(text) % 8)
open(sys.argv[2], "wb").write(struct.pack("<Q", len(text)) + text + data[8 + n:])
PYTHON
}
U='{ "field": "U", "range": [-2, 3] }' p='{ "field": "p", "range": [-100, 100] }'
model ../like.safetensors "{ \"cell_size\": [0.01, 0.04], \"speed\": [0.5, 3], \"courant\": [0.1, 3], \"inputs\": [$U, $p] }"
model ../unlike.safetensors "{ \"cell_size\": [0.001, 0.002], \"speed\": [20, 30], \"courant\": [100, 200], \"inputs\": [$U, $p] }"
surrogate() { function_object m4gnSurrogate "mode observe; model \"$work/$1.safetensors\"; timeStart 0.01; $2"; }

surrogate like 'outOfRange refuse;'
runs icoFoam
! grep -q 'was trained on' log.run || { cat log.run; fail "a case like the data is reported"; }
surrogate unlike ''
clean_case
runs icoFoam
for what in 'mean distance of neighbouring cells is [0-9.e-]* m, and the model was trained on 1.000e-3 to 2.000e-3 m' \
    'largest speed is [0-9.e-]* m/s, and the model was trained on 2.000e1 to 3.000e1 m/s' 'Courant number of the stride is'; do
    grep -q "$what" log.run || { cat log.run; fail "not said: $what"; }
done
[ "$(grep -c 'and the model was trained on' log.run)" -eq 3 ] || fail "it is said more than once"
# Inputs are inside: nothing is said of them
! grep -q ' U is \| p is ' log.run || fail "inputs are reported"
surrogate unlike 'outOfRange refuse;'
refused 'is not what the model' icoFoam
surrogate unlike 'outOfRange ignore;'
clean_case
runs icoFoam
! grep -q 'was trained on' log.run || fail "outOfRange ignore says something"
surrogate unlike 'outOfRange perhaps;'
refused 'Entry outOfRange is perhaps; expected warn, refuse or ignore' icoFoam

# Two ranks say what one does
surrogate unlike ''
clean_case
on_two_ranks icoFoam
grep -q 'largest speed is' log.run || { cat log.run; fail "two ranks do not say it"; }
echo "trained-on: passed"
