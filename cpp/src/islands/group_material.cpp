#include "dashpot/islands/group_material.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "dashpot/law/solref.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/properties.hpp"

namespace dashpot {

namespace {

// A contact or constraint that no material covers: rigid, or what the model's own solref means.
template <typename Input>
GroupMaterial from_solref(const Input& input, double load) {
  return input.has_solref ? solref_material(input.solref, input.solimp, load) : GroupMaterial();
}

}  // namespace

GroupMaterial solref_material(const std::array<double, 2>& solref,
                              const std::array<double, 5>& solimp, double load) {
  const auto [stiffness, damping] = solref_to_spring_at_rest(solref, solimp, load);
  GroupMaterial given;
  given.from_solref = true;
  given.normalised_stiffness = stiffness;
  given.normalised_damping = damping;
  given.own_damping = damping;
  given.load = load;
  return given;
}

GroupMaterial material_of(const mjModel_* model, const Parameters& parameters,
                          const ContactInput& input, double load) {
  if (!parameters.pair_material.empty()) {
    const auto [low, high] = std::minmax(input.geom[0], input.geom[1]);
    const auto pair = parameters.pair_material.find({low, high});
    if (pair != parameters.pair_material.end()) return {pair->second};
  }
  const auto from_model = [&](int geom) {
    return geom < 0 || parameters.geom_material[geom].from_model;
  };
  if (from_model(input.geom[0]) && from_model(input.geom[1])) {
    try {
      return from_solref(input, load);
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument("contact of " + host::contact_side(model, input.geom[0]) +
                                  " and " + host::contact_side(model, input.geom[1]) + ": " +
                                  error.what());
    }
  }
  Material side[2];
  for (int i = 0; i < 2; ++i) {
    if (input.geom[i] < 0)
      side[i].from_model = true;
    else
      side[i] = parameters.geom_material[input.geom[i]];
  }
  const bool overridden = side[0].has_friction || side[1].has_friction;
  const bool load_dependent = side[0].loaded_friction < 1.0 || side[1].loaded_friction < 1.0;
  if (overridden || load_dependent)
    for (int i = 0; i < 2; ++i) {
      const std::array<double, 3> own = host::geom_friction(model, input.geom[i]);
      for (size_t j = 0; j < own.size(); ++j)
        if (!side[i].has_friction || std::isnan(side[i].friction[j])) side[i].friction[j] = own[j];
      side[i].has_friction = overridden;
    }
  // A side that nobody set has no damping of its own to mix in.
  for (int i = 0; i < 2; ++i)
    if (side[i].from_model) {
      side[i].form = side[1 - i].form;
      side[i].damping = side[1 - i].damping;
    }
  Material combined = combine(side[0], side[1], parameters.options.rules);
  // Rigid rows tell a restitution, of one contact, from a damping ratio, of a coupled mode.
  if (combined.rigid && side[0].form == DampingForm::kRestitution &&
      side[1].form == DampingForm::kRestitution) {
    combined.form = DampingForm::kRestitution;
    combined.damping = damping_ratio_to_restitution(combined.damping);
  }
  const int priority[2] = {host::geom_priority(model, input.geom[0]),
                           host::geom_priority(model, input.geom[1])};
  if (priority[0] != priority[1]) {
    const Material& prior = side[priority[1] > priority[0]];
    combined.friction = prior.friction;
    combined.loaded_friction = prior.loaded_friction;
    combined.friction_load = prior.friction_load;
  }
  return {combined};
}

GroupMaterial material_of(const ConstraintInput& input) {
  if (input.damping > 0.0) {
    GroupMaterial damper;
    damper.material.rigid = false;
    damper.material.stiffness = 0.0;
    damper.material.form = DampingForm::kDamping;
    damper.material.damping = input.damping;
    return damper;
  }
  return from_solref(input, std::numeric_limits<double>::infinity());
}

std::array<double, 5> friction_of(const ContactInput& input, const Material& material) {
  std::array<double, 5> friction = input.friction;
  if (!material.has_friction) return friction;
  const int coefficient[5] = {0, 0, 1, 2, 2};
  for (int i = 0; i < 5; ++i) {
    const double overriding = material.friction[coefficient[i]];
    if (!std::isnan(overriding)) friction[i] = overriding;
  }
  return friction;
}

}  // namespace dashpot
