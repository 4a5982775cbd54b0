#!/usr/bin/env bash
# Inlet speeds of a cylinder in a channel: cold and plain to the end; until the lift is known cold, from the nearest sister's last state, that with dmd,
# and from the sisters' cycles.
#   bench/campaign.sh FOLDER [RUNS]    (docs/lab/2026-11-campaign.md)
set -euo pipefail
# shellcheck source=setup/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/../setup/common.sh"
# shellcheck source=env.sh
. "$M4GN_HOME/env.sh"
mkdir -p "$1" && cd "$1"
header="FoamFile { version 2.0; format ascii; class dictionary; object simulationParameters; }"

cp -r "$M4GN_HOME/openfoam/templates/cylinder-flow" case
cd case
rm -r family.toml source
sed -i 's/@x@/0.31/; s/@y@/0.212/; s/@radius@/0.052/; s/@size@/0.05/; s/@nu@/1e-3/; s/@shape@/0/; s/@elements@/0/' \
    mesh.geo constant/transportProperties
sed -i 's/@tolerance@/1e-6/; s/@correctors@/1/; s/@convection@/0/' system/fv{Solution,Schemes}
sed -i 's/@endTime@/8/; s/@deltaT@/0.002/; s/@writeInterval@/10/' system/controlDict
# shellcheck disable=SC2016  # names of OpenFOAM
sed -i 's/@linear@/$linear/; s/@quadratic@/$quadratic/; s/^dimensions/#include "<system>\/simulationParameters"\n&/' 0/U
echo "$header u0 1; linear 1; quadratic 1;" > system/simulationParameters
cat > system/functions <<'EOD'
forces
{
    #include "<system>/simulationParameters"
    type forceCoeffs; libs (forces); patches (cylinder);
    rho rhoInf; rhoInf 1; CofR (0.31 0.212 0); liftDir (0 1 0); dragDir (1 0 0); pitchAxis (0 0 1);
    magUInf $u0; lRef 0.104; Aref 0.00104; log no;
}
EOD
gmsh -nt 1 -3 -format msh2 -o mesh.msh mesh.geo
gmshToFoam mesh.msh
changeDictionary -constant
rm mesh.msh mesh.geo
cd ..

mapfile -t speeds < <(awk -v n="${2:-8}" 'BEGIN { for (i = 0; i < n; ++i) printf "%.6g\n", 1.4 + 0.7*i/(n - 1) }')
list() { printf '%s\n' "${speeds[@]}" | awk -v f="$1" '{ printf "%s%.8g", (NR > 1 ? "," : ""), f*$1 }'; }
for name in nearest cycle dmd until cold; do
    m4gn campaign init case --out "$name" --sampling list --parameter "u0=$(list 1)" --parameter "linear=$(list 9.7560976)" \
        --parameter "quadratic=$(list -23.795360)"
    # The drag is told, and not waited for
    sed -i 's/^held_out = .*/held_out = 0/; s/^min_time = .*/min_time = 1/; /^relative = 0.01/d; s/^# scale = .*/scale = "u0"/' \
        "$name/campaign.toml"
done
sed -i 's/^start = .*/start = "cold"/' until/campaign.toml cold/campaign.toml
sed -i 's/^stop = .*/stop = false/' cold/campaign.toml
sed -i 's/^start = .*/start = "nearest"/' nearest/campaign.toml dmd/campaign.toml
sed -i 's/^# surrogate = .*/surrogate = "dmd"/; s/^# surrogate_entries = .*/surrogate_entries = "dmd { snapshotInterval 0.05; }"/' dmd/campaign.toml
for name in nearest cycle dmd until cold; do
    m4gn campaign run --store "$name"
    m4gn campaign report --store "$name"
done
