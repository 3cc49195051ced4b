// Whether a model can have rows at all.

#pragma once

struct mjModel_;

namespace dashpot::host {

// Whether any contact, limit, equality or dry friction could act in some state of a model, as it is
// now: its flags and values may be edited between steps. Trees of a model without any are MuJoCo's
// to integrate, bit for bit.
bool may_have_rows(const mjModel_* m);

}  // namespace dashpot::host
