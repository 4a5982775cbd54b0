// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnModel.H"

Foam::m4gnModel::m4gnModel(const fileName& file)
:
    file_(file),
    model_(nullptr)
{
    m4gn::check
    (
        m4gn_model_open(m4gn::communicator(), file_.c_str(), &model_),
        "The model cannot be read"
    );
}

Foam::m4gnModel::~m4gnModel()
{
    m4gn_model_free(model_);
}

Foam::label Foam::m4gnModel::elasticModes() const
{
    const int32_t count = m4gn_model_elastic_modes(model_);
    if (count < 0)
    {
        m4gn::check(M4GN_ERROR_MODEL, "The model cannot be used");
    }
    return count;
}
