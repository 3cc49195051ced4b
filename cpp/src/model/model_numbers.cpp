#include <mujoco/mujoco.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/law/text.hpp"
#include "dashpot/model/checks.hpp"
#include "dashpot/model/errors.hpp"

namespace dashpot::host {

namespace {

enum class Range { kFinite, kNotNegative, kNumber };

bool lie_in(Range range, const mjtNum* values, mjtSize count) {
  return range == Range::kNotNegative ? are_finite_and_not_negative(values, count)
                                      : are_finite(values, count);
}

bool lies_in(Range range, mjtNum value) {
  if (range == Range::kNumber) return !std::isnan(value);
  return std::isfinite(value) && (range == Range::kFinite || value >= 0.0);
}

const char* words(Range range) {
  return range == Range::kFinite   ? "finite"
         : range == Range::kNumber ? "a number"
                                   : "finite and >= 0";
}

// The joint that an entry of qpos is of.
int joint_of_entry(const mjModel* m, int entry) {
  int joint = 0;
  while (joint + 1 < m->njnt && m->jnt_qposadr[joint + 1] <= entry) ++joint;
  return joint;
}

// Objects of one kind in a model.
class Objects {
 public:
  Objects(const mjModel* m, const char* kind, mjtObj type, mjtSize count)
      : m_(m), kind_(kind), type_(type), count_(count) {}

  // `each` values of every object.
  void check(const char* field, const mjtNum* values, int each,
             Range range = Range::kFinite) const {
    if (lie_in(range, values, each * count_)) return;
    for (mjtSize i = 0; i < each * count_; ++i)
      if (!lies_in(range, values[i]))
        throw std::invalid_argument(of(field, static_cast<int>(i / each)) + " holds " +
                                    text(values[i]) + "; it must be " + words(range));
  }

  // `is_read` (by object): whether steps may read it; what MuJoCo never reads may be of any format.
  template <typename IsRead>
  void check_solref(const char* field, const mjtNum* values, const IsRead& is_read) const {
    check(field, values, mjNREF);
    for (int i = 0; i < count_; ++i) {
      const mjtNum* const ref = values + mjNREF * i;
      if ((ref[0] > 0.0) != (ref[1] > 0.0) && is_read(i))
        throw std::invalid_argument(
            of(field, i) + " is (" + text(ref[0]) + ", " + text(ref[1]) +
            "); it must be two positive numbers (timeconst, dampratio) or two that are not "
            "positive (-stiffness, -damping)");
    }
  }

 private:
  // Degrees of freedom and entries of qpos (mjOBJ_UNKNOWN) are named by their joints.
  std::string of(const char* field, int id) const {
    const std::string name = type_ == mjOBJ_DOF ? named(m_, mjOBJ_JOINT, m_->dof_jntid[id])
                             : type_ == mjOBJ_UNKNOWN
                                 ? named(m_, mjOBJ_JOINT, joint_of_entry(m_, id))
                                 : named(m_, type_, id);
    return "model." + std::string(field) + " of " + kind_ + " " + name;
  }

  const mjModel* m_;
  const char* kind_;
  mjtObj type_;
  mjtSize count_;
};

// Of objects that may act at any time.
constexpr auto kAlways = [](int) { return true; };

void check_geoms(const mjModel* m) {
  const Objects geoms(m, "geom", mjOBJ_GEOM, m->ngeom);
  geoms.check("geom_friction", m->geom_friction, 3, Range::kNotNegative);
  geoms.check("geom_size", m->geom_size, 3, Range::kNotNegative);
  geoms.check("geom_pos", m->geom_pos, 3);
  geoms.check("geom_quat", m->geom_quat, 4);
  geoms.check("geom_margin", m->geom_margin, 1);
  geoms.check("geom_gap", m->geom_gap, 1);
  geoms.check_solref("geom_solref", m->geom_solref,
                     [&](int i) { return m->geom_contype[i] != 0 || m->geom_conaffinity[i] != 0; });
  geoms.check("geom_solimp", m->geom_solimp, mjNIMP);
  geoms.check("geom_solmix", m->geom_solmix, 1);
  geoms.check("geom_surfacevel", m->geom_surfacevel, 6);
  geoms.check("geom_adhesion", m->geom_adhesion, 1);
}

void check_pairs(const mjModel* m) {
  const Objects pairs(m, "pair", mjOBJ_PAIR, m->npair);
  pairs.check("pair_friction", m->pair_friction, 5, Range::kNotNegative);
  pairs.check("pair_margin", m->pair_margin, 1);
  pairs.check("pair_gap", m->pair_gap, 1);
  pairs.check_solref("pair_solref", m->pair_solref, kAlways);
  pairs.check_solref("pair_solreffriction", m->pair_solreffriction, kAlways);
  pairs.check("pair_solimp", m->pair_solimp, mjNIMP);
  pairs.check("pair_adhesion", m->pair_adhesion, 1);
}

void check_flexes(const mjModel* m) {
  const Objects flexes(m, "flex", mjOBJ_FLEX, m->nflex);
  flexes.check("flex_friction", m->flex_friction, 3, Range::kNotNegative);
  flexes.check("flex_margin", m->flex_margin, 1);
  flexes.check("flex_gap", m->flex_gap, 1);
  flexes.check_solref("flex_solref", m->flex_solref, kAlways);
  flexes.check("flex_solimp", m->flex_solimp, mjNIMP);
  flexes.check("flex_solmix", m->flex_solmix, 1);
  flexes.check("flex_radius", m->flex_radius, 1, Range::kNotNegative);
  flexes.check("flex_damping", m->flex_damping, 1);
  flexes.check("flex_edgestiffness", m->flex_edgestiffness, 1);
  flexes.check("flex_edgedamping", m->flex_edgedamping, 1);
}

void check_bodies(const mjModel* m) {
  const Objects bodies(m, "body", mjOBJ_BODY, m->nbody);
  bodies.check("body_pos", m->body_pos, 3);
  bodies.check("body_quat", m->body_quat, 4);
  bodies.check("body_ipos", m->body_ipos, 3);
  bodies.check("body_iquat", m->body_iquat, 4);
  bodies.check("body_gravcomp", m->body_gravcomp, 1);
}

void check_joints(const mjModel* m) {
  const Objects joints(m, "joint", mjOBJ_JOINT, m->njnt);
  joints.check("jnt_pos", m->jnt_pos, 3);
  joints.check("jnt_axis", m->jnt_axis, 3);
  joints.check("jnt_range", m->jnt_range, 2, Range::kNumber);
  joints.check("jnt_actfrcrange", m->jnt_actfrcrange, 2, Range::kNumber);
  joints.check("jnt_margin", m->jnt_margin, 1, Range::kNumber);
  joints.check_solref("jnt_solref", m->jnt_solref, [&](int i) { return m->jnt_limited[i] != 0; });
  joints.check("jnt_solimp", m->jnt_solimp, mjNIMP);
  joints.check("jnt_stiffness", m->jnt_stiffness, 1);
  joints.check("jnt_stiffnesspoly", m->jnt_stiffnesspoly, mjNPOLY);
  const Objects entries(m, "joint", mjOBJ_UNKNOWN, m->nq);
  entries.check("qpos0", m->qpos0, 1);
  entries.check("qpos_spring", m->qpos_spring, 1);
  const Objects dofs(m, "joint", mjOBJ_DOF, m->nv);
  dofs.check("dof_armature", m->dof_armature, 1, Range::kNotNegative);
  dofs.check("dof_damping", m->dof_damping, 1);
  dofs.check("dof_dampingpoly", m->dof_dampingpoly, mjNPOLY);
  dofs.check("dof_frictionloss", m->dof_frictionloss, 1);
  dofs.check_solref("dof_solref", m->dof_solref,
                    [&](int i) { return m->dof_frictionloss[i] > 0.0; });
  dofs.check("dof_solimp", m->dof_solimp, mjNIMP);
}

void check_sites(const mjModel* m) {
  const Objects sites(m, "site", mjOBJ_SITE, m->nsite);
  sites.check("site_pos", m->site_pos, 3);
  sites.check("site_quat", m->site_quat, 4);
}

void check_equalities(const mjModel* m) {
  const Objects equalities(m, "equality", mjOBJ_EQUALITY, m->neq);
  equalities.check("eq_data", m->eq_data, mjNEQDATA);
  equalities.check_solref("eq_solref", m->eq_solref, kAlways);
  equalities.check("eq_solimp", m->eq_solimp, mjNIMP);
}

void check_tendons(const mjModel* m) {
  const Objects tendons(m, "tendon", mjOBJ_TENDON, m->ntendon);
  tendons.check("tendon_range", m->tendon_range, 2, Range::kNumber);
  tendons.check("tendon_actfrcrange", m->tendon_actfrcrange, 2, Range::kNumber);
  tendons.check("tendon_lengthspring", m->tendon_lengthspring, 2, Range::kNumber);
  tendons.check("tendon_margin", m->tendon_margin, 1, Range::kNumber);
  tendons.check("tendon_stiffness", m->tendon_stiffness, 1);
  tendons.check("tendon_stiffnesspoly", m->tendon_stiffnesspoly, mjNPOLY);
  tendons.check("tendon_damping", m->tendon_damping, 1);
  tendons.check("tendon_dampingpoly", m->tendon_dampingpoly, mjNPOLY);
  tendons.check("tendon_armature", m->tendon_armature, 1, Range::kNotNegative);
  tendons.check("tendon_frictionloss", m->tendon_frictionloss, 1);
  tendons.check_solref("tendon_solref_lim", m->tendon_solref_lim,
                       [&](int i) { return m->tendon_limited[i] != 0; });
  tendons.check("tendon_solimp_lim", m->tendon_solimp_lim, mjNIMP);
  tendons.check_solref("tendon_solref_fri", m->tendon_solref_fri,
                       [&](int i) { return m->tendon_frictionloss[i] > 0.0; });
  tendons.check("tendon_solimp_fri", m->tendon_solimp_fri, mjNIMP);
}

// `each` values of every control or output of an actuator, which has a number from an address on.
void check_of_actuators(const mjModel* m, const char* field, const mjtNum* values, int each,
                        const int* address, const int* number, Range range) {
  for (int i = 0; i < m->nactuator; ++i) {
    const mjtNum* const own = values + each * address[i];
    for (int k = 0; k < each * number[i]; ++k)
      if (!lies_in(range, own[k]))
        throw std::invalid_argument("model." + std::string(field) + " of actuator " +
                                    named(m, mjOBJ_ACTUATOR, i) + " holds " + text(own[k]) +
                                    "; it must be " + words(range));
  }
}

void check_actuators(const mjModel* m) {
  const Objects actuators(m, "actuator", mjOBJ_ACTUATOR, m->nactuator);
  actuators.check("actuator_dynprm", m->actuator_dynprm, mjNDYN);
  actuators.check("actuator_gainprm", m->actuator_gainprm, mjNGAIN);
  actuators.check("actuator_biasprm", m->actuator_biasprm, mjNBIAS);
  actuators.check("actuator_damping", m->actuator_damping, 1);
  actuators.check("actuator_dampingpoly", m->actuator_dampingpoly, mjNPOLY);
  actuators.check("actuator_armature", m->actuator_armature, 1);
  actuators.check("actuator_cranklength", m->actuator_cranklength, 1);
  actuators.check("actuator_actrange", m->actuator_actrange, 2, Range::kNumber);
  actuators.check("actuator_forcerange", m->actuator_forcerange, 2, Range::kNumber);
  check_of_actuators(m, "actuator_ctrlrange", m->actuator_ctrlrange, 2, m->actuator_ctrladr,
                     m->actuator_ctrlnum, Range::kNumber);
  check_of_actuators(m, "actuator_gear", m->actuator_gear, 6, m->actuator_outadr,
                     m->actuator_outnum, Range::kFinite);
}

}  // namespace

void check_numbers(const mjModel_* m) {
  check_geoms(m);
  check_pairs(m);
  check_flexes(m);
  check_bodies(m);
  check_joints(m);
  check_sites(m);
  check_equalities(m);
  check_tendons(m);
  check_actuators(m);
}

}  // namespace dashpot::host
