// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnActiveSurrogate.H"

Foam::DynamicList<const Foam::m4gnActiveSurrogate*> Foam::m4gnActiveSurrogate::all_;

Foam::m4gnActiveSurrogate::m4gnActiveSurrogate(const word& name) : replacerName_(name) { all_.append(this); }

Foam::m4gnActiveSurrogate::~m4gnActiveSurrogate() { all_.remove(all_.find(this)); }

Foam::word Foam::m4gnActiveSurrogate::before(const scalar time, const m4gnActiveSurrogate* other)
{
    for (const m4gnActiveSurrogate* one : all_) {
        if (one != other && one->replacesFrom() < time) {
            return one->replacerName_;
        }
    }

    return word::null;
}
