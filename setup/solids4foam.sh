#!/usr/bin/env bash
# Builds the solid part of solids4foam (2.2, or its branch feature-petsc-snes) from a source of yours against the OpenFOAM that m4gn uses, where there is no
# wmake or solids4foam asks for a later version (it wants v2012; Debian has v1912). m4gn's own library for it comes with it.
#   setup/solids4foam.sh SOURCE [FOLDER]    SOURCE: its checkout or unpacked release; FOLDER: ~/.cache/m4gn/solids4foam
#   setup/solids4foam.sh                    m4gn's own library alone, for the solids4foam that was built before
# Prints what to set; tests and tutorials find the default FOLDER by themselves. Left out: fluids and their interaction with solids, thermal solids, plates; before v2012 solidContact.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

models=src/solids4FoamModels
[ $# -le 2 ] || die "expected at most two folders" "usage: setup/solids4foam.sh [SOURCE [FOLDER]]"
if [ $# -eq 0 ]; then
    solids4foam_environment || die "there is no solids4foam in ${SOLIDS4FOAM_INST_DIR:-$M4GN_CACHE/solids4foam}" \
        "Give the folder that a checkout of solids4foam, or its unpacked release, makes."
else
    [ -e "$1/$models/Make/files.openfoam" ] ||
        die "$1 is no source of solids4foam: it has no $models/Make/files.openfoam" \
            "Give the folder that a checkout of solids4foam, or its unpacked release, makes."
    from=$(cd "$1" && pwd)
    into=${2:-$M4GN_CACHE/solids4foam}
    if [ "$(realpath -m "$into")" = "$M4GN_HOME" ]; then
        die "$into is m4gn's own folder" "Give another one: its source, cmake, setup, build, bin and lib are replaced."
    fi
    if [[ $(realpath -m "$from")/ == "$(realpath -m "$into/source")"/* ]]; then
        die "$from is the copy of the source in $into, which is made anew each time" "Give the folder that it was copied from."
    fi
    "$M4GN_HOME/setup/debian.sh" solids4foam
    foam_sourced || "$M4GN_HOME/setup/openfoam-source.sh"
    SOLIDS4FOAM_INST_DIR=$(realpath -m "$into") && into=$SOLIDS4FOAM_INST_DIR
    SOLIDS4FOAM_DIR=$into/source SOLIDS4FOAM_LIB_DIR=$into/lib
fi
foam=$("$M4GN_HOME/setup/openfoam.sh" --export)
eval "$foam"

# Its libraries and the function objects have to be of one OpenFOAM
openfoam="$M4GN_FOAM_VERSION in $M4GN_FOAM_PROJECT_DIR"
if [ $# -eq 0 ]; then
    built=$(cat "$SOLIDS4FOAM_INST_DIR/.openfoam" 2>/dev/null || echo "$openfoam")
    [ "$built" = "$openfoam" ] || {
        warn "solids4foam in $SOLIDS4FOAM_INST_DIR is built for OpenFOAM $built, and not for $openfoam: nothing is built for it." \
            "To have it here, type setup/solids4foam.sh SOURCE"
        exit 0
    }
fi

# What is not built, as a pattern of the paths in Make/files.openfoam
left_out='^(fluidModels|fluidSolidInterfaces)/|/(coupledUns|kirchhoffPlate|poroLinGeom|thermal|weakThermal)[A-Za-z]*Solid/|thermalConvection'
left_out+='|poroMechanicalLaw|thermoMechanicalLaw|fixedTemperature|hotCylinder|solidPointTemperature|fsiConvergenceData|anisotropicBiot'

# sources PART: the files of a part, from its list for wmake
sources() {
    sed -zE 's,/\*([^*]|\*+[^*/])*\*+/,,g' "$1/Make/files.openfoam" | awk '
        { gsub(/[ \t]/, ""); line = $0 }
        /^LIB=/ || !NF { next }
        { while (match(line, /\$\([A-Za-z]+\)/))
              line = substr(line, 1, RSTART - 1) of[substr(line, RSTART + 2, RLENGTH - 3)] substr(line, RSTART + RLENGTH) }
        /^[A-Za-z]+=/ { split(line, pair, "="); of[pair[1]] = pair[2]; next }
        { print line }' | grep -vE "$left_out"
}

# v1912 differs from what solids4foam asks for in these places.
adapt() {
    local numerics=$models/numerics
    sed -i -E 's/PrimitivePatch<(List<face>|faceList), pointField>/PrimitivePatch<face, List, pointField>/' \
        "$numerics/globalPolyPatch/standAlonePatch.H" &&
        sed -i -E 's/PrimitivePatch<FaceList<face>, const pointField&>/PrimitivePatch<face, FaceList, const pointField\&>/' \
            "$numerics/fvc/fvcGradf.H" "$numerics/fvc/fvcGradf.C" &&
        sed -i -E 's/#if(def)? OPENFOAM_COM/#if 0/' \
            src/blockCoupledSolids4FoamTools/newLeastSquaresVolPointInterpolation/newLeastSquaresVolPointInterpolation.C &&
        cat >"$numerics/realEigenValues/realEigenValues.C" <<'CODE'
#include "realEigenValues.H"
Foam::vector Foam::realEigenValues(const tensor& t) { return eigenValues(t); }
Foam::tensor Foam::realEigenVectors(const tensor& t) { return eigenVectors(t); }
CODE
}

# Its branch feature-petsc-snes includes a header of foam-extend, leaves files out of its list, asks a matrix that has no memory yet
# for its use, and gives it that of another type, so that each entry is an error.
correct() {
    local helper=$models/solidModels/solidModel/foamPetscSnesHelper/foamPetscSnesHelper.C
    [ -e "$helper" ] || return 0
    sed -i 's/#include "foamTime.H"/#include "Time.H"/' \
        "$models/solidModels/fvPatchFields/solidTractionFree/solidTractionFreeFvPatchVectorField.H" &&
        sed -i -e 's/MatInfo info;/PetscBool assembled;/; s/MatGetInfo(B, MAT_LOCAL, &info)/MatAssembled(B, \&assembled)/' \
            -e 's/if (info.nz_used)/if (assembled)/' \
            -e 's/MatMPIBAIJSetPreallocation(B, blockSize, 0, d_nnz, 0, o_nnz)/MatXAIJSetPreallocation(B, blockSize, d_nnz, o_nnz, NULL, NULL)/' \
            "$helper" &&
        printf 'numerics/sparseMatrix/%s.C\n' sparseMatrix SparseMatrixTemplates sparseMatrixTools >> "$models/Make/files.openfoam"
}

prepare() {
    local part library
    rm -rf "$into/source" && mkdir -p "$into/source" && cp -r "$from/src" "$from/applications" "$from/tutorials" "$into/source" &&
        cd "$into/source" && correct || return
    if [ "$M4GN_FOAM_VERSION" -lt 2012 ]; then
        adapt || return
        # solidContact and its interpolation between patches ask for faceAreaIntersect and refPtr of later versions
        left_out+='|AMI|amiZone|[sS]olidContact/'
    fi
    for part in solids4FoamModels blockCoupledSolids4FoamTools; do
        sources "src/$part" >"src/$part/sources" || return
    done
    for part in solids4FoamModels blockCoupledSolids4FoamTools RBFMeshMotionSolver; do
        (cd src && WM_ARCH=linux64 "$M4GN_FOAM_SRC/../wmake/wmakeLnInclude" -silent "$part")
    done
    for library in finiteArea topoChangerFvMesh fvMotionSolver optimisation/adjointOptimisation/adjoint; do
        [ -d "$M4GN_FOAM_SRC/$library/lnInclude" ] ||
            (cd "$M4GN_FOAM_SRC" && WM_ARCH=linux64 ../wmake/wmakeLnInclude -silent "$library")
    done
}

build() {
    # The probe for OpenFOAM comes along, so that nothing there depends on this checkout.
    rm -rf "$into"/{cmake,setup,.openfoam} && cp -r "$M4GN_HOME"/{cmake,setup} "$into" || return
    configure "$into/cmake/solids4foam" "$into/build" -DCMAKE_BUILD_TYPE=Release \
        -DSOLIDS4FOAM_SOURCE="$into/source" -DCMAKE_INSTALL_PREFIX="$into" &&
        cmake --build "$into/build" && cmake --install "$into/build" && echo "$openfoam" >"$into/.openfoam"
}

# libm4gnSolids4Foam.so, which asks the solver's material law
build_m4gn() {
    configure "$M4GN_HOME/openfoam/solids4foam" "$M4GN_HOME/target/solids4foam" -DCMAKE_BUILD_TYPE=Release \
        -DSOLIDS4FOAM_DIR="$SOLIDS4FOAM_DIR" -DSOLIDS4FOAM_LIB_DIR="$SOLIDS4FOAM_LIB_DIR" && cmake --build "$M4GN_HOME/target/solids4foam"
}

if [ $# -gt 0 ]; then
    step "solids4foam: source" prepare || die "the source of solids4foam could not be prepared in $into"
    step "solids4foam" build || die "solids4foam did not build; it was tried with version 2.2 and the branch feature-petsc-snes"
fi
if [ -f "$M4GN_HOME/lib/libm4gnFoam.so" ]; then
    step "m4gn for solids4foam" build_m4gn || die "openfoam/solids4foam did not build"
else
    warn "lib/libm4gnFoam.so is not there yet: after ./Allrun --setup-only type setup/solids4foam.sh for lib/libm4gnSolids4Foam.so"
fi
printf 'export SOLIDS4FOAM_INST_DIR=%q SOLIDS4FOAM_DIR=%q SOLIDS4FOAM_LIB_DIR=%q\n' \
    "$SOLIDS4FOAM_INST_DIR" "$SOLIDS4FOAM_DIR" "$SOLIDS4FOAM_LIB_DIR"
echo "export PATH=\$SOLIDS4FOAM_INST_DIR/bin:\$PATH LD_LIBRARY_PATH=\$SOLIDS4FOAM_INST_DIR/lib:\$LD_LIBRARY_PATH"
