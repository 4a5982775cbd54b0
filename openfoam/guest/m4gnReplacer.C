// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnReplacer.H"

Foam::DynamicList<const Foam::m4gnReplacer*> Foam::m4gnReplacer::all_;

Foam::m4gnReplacer::m4gnReplacer(const word& name) : replacerName_(name) { all_.append(this); }

Foam::m4gnReplacer::~m4gnReplacer()
{
    DynamicList<const m4gnReplacer*> left;
    for (const m4gnReplacer* other : all_) {
        if (other != this) {
            left.append(other);
        }
    }
    all_.transfer(left);
}

Foam::word Foam::m4gnReplacer::before(const scalar time, const m4gnReplacer* other)
{
    for (const m4gnReplacer* one : all_) {
        if (one != other && one->replacesFrom() < time) {
            return one->replacerName_;
        }
    }

    return word::null;
}

Foam::m4gnReplacer::state Foam::m4gnReplacer::last(const fvMesh& mesh)
{
    for (const m4gnReplacer* one : all_) {
        const state made(one->lastState(mesh));
        if (made.timeIndex >= 0) {
            return made;
        }
    }

    return {-1, false, 0};
}
