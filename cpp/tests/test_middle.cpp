// The geometry of the middle of a step, where memory does not suffice for it: what MuJoCo's data
// held at the start comes back.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "checks.hpp"
#include "compiled_scene.hpp"
#include "dashpot/detect/detection.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/threads/team.hpp"

namespace {

constexpr int kContactCapacity = 400;

// 30 boxes that will lie on a floor in the middle of the step, where MuJoCo's rows of their
// contacts take more than the memory of the model.
void check_restored_middle() {
  std::string boxes;
  for (int i = 0; i < 30; ++i)
    boxes += "<body pos='" + std::to_string(0.25 * i) +
             " 0 .101'><freejoint/><geom type='box' size='.1 .1 .1'/></body>";
  mjModel* m = compile(
      "<mujoco><size memory='110000'/><option timestep='.004' cone='elliptic'/><worldbody>"
      "<geom type='plane' size='9 9 .1'/>" +
          boxes + "</worldbody></mujoco>",
      kContactCapacity);
  mjData* d = mj_makeData(m);
  mj_fwdKinematics(m, d);
  const std::vector<double> qpos(d->qpos, d->qpos + m->nq), xpos(d->xpos, d->xpos + 3 * m->nbody);
  std::vector<double> fall(m->nv, 0.0);
  const double half = 0.5 * m->opt.timestep;
  for (int i = 2; i < m->nv; i += 6) fall[i] = -0.001 / (0.5 * half * half);
  dashpot::host::Detection detection;
  dashpot::Team team(1);
  std::vector<dashpot::ContactInput> contacts;
  std::vector<dashpot::ConstraintInput> constraints;
  bool thrown = false;
  try {
    const dashpot::host::MiddleGeometry middle(m, d, fall, detection, contacts, constraints, team);
  } catch (const std::runtime_error&) {
    thrown = true;
  }
  check(thrown, "rows that do not fit in the middle of a step are an error");
  check(std::equal(qpos.begin(), qpos.end(), d->qpos), "an error in the middle keeps positions");
  check(std::equal(xpos.begin(), xpos.end(), d->xpos), "an error in the middle keeps kinematics");
  mj_deleteData(d);
  mj_deleteModel(m);
}

// MuJoCo needs its stack for the kinematics of a spatial tendon. Where contacts and rows of the
// middle have left none, coming back to the start is an error that can be caught, also while
// another one is on its way.
void check_return_from_the_middle_without_room() {
  mjModel* m = compile(
      "<mujoco><worldbody><site name='anchor'/><body pos='0 0 1'><freejoint/>"
      "<geom size='.1'/><site name='end'/></body></worldbody>"
      "<tendon><spatial><site site='anchor'/><site site='end'/></spatial></tendon></mujoco>",
      kContactCapacity);
  mjData* d = mj_makeData(m);
  mj_forward(m, d);
  const std::vector<double> qpos(d->qpos, d->qpos + m->nq), still(m->nv, 0.0);
  d->qvel[2] = 1.0;
  dashpot::host::Detection detection;
  dashpot::Team team(1);
  std::vector<dashpot::ContactInput> contacts;
  std::vector<dashpot::ConstraintInput> constraints;
  bool leaving_throws = false, first_error_is_told = false;
  for (const bool leaves : {true, false}) {
    const dashpot::host::ErrorGuard guard(d);
    try {
      dashpot::host::MiddleGeometry middle(m, d, still, detection, contacts, constraints, team);
      d->parena = d->narena - d->pstack;
      if (leaves) middle.leave();
      throw std::runtime_error("first");
    } catch (const dashpot::host::StackOverflow&) {
      leaving_throws = leaves;
    } catch (const std::runtime_error&) {
      first_error_is_told = !leaves;
    }
    check(std::equal(qpos.begin(), qpos.end(), d->qpos), "positions come back without room");
    mj_resetData(m, d);
    mj_forward(m, d);
    d->qvel[2] = 1.0;
  }
  check(leaving_throws, "kinematics without room are an error");
  check(first_error_is_told, "an error within the middle outlives the way back");
  mj_deleteData(d);
  mj_deleteModel(m);
}

}  // namespace

int main() {
  check_restored_middle();
  check_return_from_the_middle_without_room();
  return exit_status();
}
