#!/usr/bin/env bash
# A model that says what it was trained on, in a case that is like it and in one that is not.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.03

# model FILE TRAINED_ON: the small model with this record in its description
model() { edit_model "$1" 'model["trained_on"] = json.loads(arguments[0])' "$2"; }
U='{ "field": "U", "range": [-2, 3] }' p='{ "field": "p", "range": [-100, 100] }'
model ../like.safetensors "{ \"cell_size\": [0.01, 0.04], \"speed\": [0.5, 3], \"courant\": [0.1, 3], \"inputs\": [$U, $p] }"
model ../unlike.safetensors "{ \"cell_size\": [0.001, 0.002], \"speed\": [20, 30], \"courant\": [100, 200], \"inputs\": [$U, $p] }"
like() { echo "mode observe; model \"$work/$1.safetensors\"; timeStart 0.01; $2"; }

ride "$(like like 'outOfRange refuse;')"
expect_silence 'was trained on'
ride "$(like unlike '')"
expect_log 'mean distance of neighbouring cells is [0-9.e-]* m, and the model was trained on 1.000e-3 to 2.000e-3 m' \
    'largest speed is [0-9.e-]* m/s, and the model was trained on 2.000e1 to 3.000e1 m/s' 'Courant number of the stride is'
[ "$(grep -c 'and the model was trained on' log.run)" -eq 3 ] || fail "it is reported more than once"
# Inputs are inside
expect_silence ' U is \| p is '
expect_error 'is not what the model' "$(like unlike 'outOfRange refuse;')"
ride "$(like unlike 'outOfRange ignore;')"
expect_silence 'was trained on'
expect_error 'Entry outOfRange is perhaps; expected warn, refuse or ignore' "$(like unlike 'outOfRange perhaps;')"

# Two ranks say what one does
clean_case
surrogate "$(like unlike '')"
solve 2
expect_log 'largest speed is'
