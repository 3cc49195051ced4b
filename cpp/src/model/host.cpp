#include "dashpot/model/host.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "dashpot/model/checks.hpp"
#include "dashpot/model/contacts.hpp"
#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/sleep.hpp"
#include "dashpot/rows/trees.hpp"
#include "discrete.hpp"

namespace dashpot::host {

namespace {

// While it lives, a model has other flags that disable parts of MuJoCo.
class Disabled {
 public:
  Disabled(mjModel* m, int flags) : model_(m), own_(m->opt.disableflags) {
    m->opt.disableflags |= flags;
  }
  ~Disabled() { model_->opt.disableflags = own_; }
  Disabled(const Disabled&) = delete;
  Disabled& operator=(const Disabled&) = delete;

 private:
  mjModel* model_;
  int own_;
};

// mj_RungeKutta; where a callback raises in a stage, or the motion diverges, state, controls and
// applied forces are those of the start again.
void take_stages(const mjModel* m, mjData* d) {
  constexpr int kState = mjSTATE_INTEGRATION;
  thread_local std::vector<double> start;
  start.resize(mj_stateSize(m, kState));
  mj_getState(m, d, start.data(), kState);
  try {
    call_with_callbacks([](const mjModel* model, mjData* data) { mj_RungeKutta(model, data, 4); },
                        m, d);
    for (int i = 0; i < m->nv; ++i)
      if (!(std::abs(d->qvel[i]) <= kLargestValue))
        throw DivergenceError("motion of degree of freedom " + std::to_string(i) +
                              " diverged between the stages of RK4; data are as they were before "
                              "the step");
  } catch (...) {
    mj_setState(m, d, start.data(), kState);
    throw;
  }
}

}  // namespace

bool callbacks_may_read() {
  return mjcb_control || mjcb_passive || mjcb_act_dyn || mjcb_act_gain || mjcb_act_bias;
}

void smooth_stage(mjModel_* m, mjData_* d, bool new_control, Sensors sensors,
                  const FindContacts& find_contacts) {
  const bool reads = sensors == Sensors::kForCallbacks && m->nsensor > 0 && callbacks_may_read();
  const bool adhesive = has_adhesion(m);
  d->ncon = d->ne = d->nf = d->nl = d->nefc = 0;
  d->flg_energypos = d->flg_energyvel = d->flg_subtreevel = d->flg_rnepost = 0;
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  mj_factorM(m, d);
  // Adhesion, of actuators or of geoms, pulls along the normals of the contacts of the present
  // positions. They need no rows: MuJoCo takes contacts inside the gap without.
  if (adhesive) find_contacts(m, d);
  for (int i = 0; i < d->ncon; ++i)
    if (d->contact[i].exclude == kIncluded) d->contact[i].exclude = kInGap;
  mj_transmission(m, d);
  if (is_discrete(m)) build_metric(m, d);
  if (reads) call_with_callbacks(mj_sensorPos, m, d);
  call_with_callbacks(mj_fwdVelocity, m, d);
  if (reads) call_with_callbacks(mj_sensorVel, m, d);
  d->ncon = 0;
  if (is_discrete(m)) return accelerate_in_metric(m, d);
  if (new_control && mjcb_control && !(m->opt.disableflags & mjDSBL_ACTUATION))
    call_with_callbacks(mjcb_control, m, d);
  call_with_callbacks(mj_fwdActuation, m, d);
  mj_fwdAcceleration(m, d);
}

void make_contact_sensors(const mjModel_* m, mjData_* d) {
  const auto any = [&](int stage) {
    for (int i = 0; i < m->nsensor; ++i)
      if (m->sensor_type[i] == mjSENS_CONTACT && m->sensor_needstage[i] == stage) return true;
    return false;
  };
  if (any(mjSTAGE_POS)) call_with_callbacks(mj_sensorPos, m, d);
  if (any(mjSTAGE_VEL)) call_with_callbacks(mj_sensorVel, m, d);
}

void set_forces(const mjModel_* m, mjData_* d, const Trees& trees,
                const std::vector<double>& smooth_acceleration,
                const std::vector<double>& constraint_force) {
  std::copy(constraint_force.begin(), constraint_force.end(), d->qfrc_constraint);
  const bool discrete = is_discrete(m);
  std::copy_n(discrete ? smooth_acceleration.data() : d->qacc_smooth, m->nv, d->qacc);
  const bool any = std::any_of(constraint_force.begin(), constraint_force.end(),
                               [](double force) { return force != 0.0; });
  if (any) {
    thread_local std::vector<double> acceleration;  // a step allocates nothing
    acceleration.resize(m->nv);
    mj_solveM(m, d, acceleration.data(), constraint_force.data(), 1);
    for (size_t index = 0; discrete && index < trees.tree.size(); ++index) {
      const Tree& t = trees.tree[index];
      if (t.free_body) continue;
      double* of = acceleration.data() + t.dof_begin;
      std::copy_n(constraint_force.begin() + t.dof_begin, t.dof_count, of);
      solve_effective(trees, static_cast<int>(index), of);
    }
    mju_addTo(d->qacc, acceleration.data(), static_cast<int>(m->nv));
  }
  thread_local std::vector<int> sleeping;
  find_sleeping_dofs(m, d, sleeping);
  for (int dof : sleeping) d->qacc[dof] = 0.0;
}

const double* acceleration(const mjData_* d) { return d->qacc; }

void exchange_forces(mjData_* d, std::vector<double>& constraint_force,
                     std::vector<double>& acceleration) {
  std::swap_ranges(constraint_force.begin(), constraint_force.end(), d->qfrc_constraint);
  std::swap_ranges(acceleration.begin(), acceleration.end(), d->qacc);
}

void report_forces(const mjModel_* m, mjData_* d, const std::vector<ContactInput>& contacts,
                   const std::vector<ConstraintInput>& constraints, const Rows& rows,
                   const std::vector<double>& row_force) {
  if (d->nefc > 0) mju_zero(d->efc_force, d->nefc);
  for (const RowGroup& c : rows.group) {
    const int address = c.kind == RowKind::kContact
                            ? d->contact[contacts[c.input].source].efc_address
                            : constraints[c.input].source;
    if (address >= 0) std::copy_n(row_force.begin() + c.row, c.dim, d->efc_force + address);
  }
  call_with_callbacks(mj_sensorAcc, m, d);
}

bool is_runge_kutta(const mjModel_* m) { return m->opt.integrator == mjINT_RK4; }

void advance_all_but_motion(mjModel_* m, mjData_* d) {
  const Disabled damping(m, mjDSBL_EULERDAMP);
  mj_Euler(m, d);
}

void integrate(mjModel_* m, mjData_* d, bool uses_motion, bool any_rows) {
  const StaysAwake awake(m, d);
  if (!uses_motion || is_discrete(m))
    advance_all_but_motion(m, d);
  else if (is_runge_kutta(m) && !any_rows)
    take_stages(m, d);
  else if (takes_derivatives(m))
    mj_implicit(m, d);
  else
    mj_Euler(m, d);
}

}  // namespace dashpot::host
