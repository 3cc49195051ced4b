// Steps that threads share against those of one thread, bit for bit. Run under the sanitizers it
// also shows that no thread reads or writes outside the arrays of a step, or of another.

#include <mujoco/mujoco.h>

#include <cstring>
#include <string>

#include "checks.hpp"
#include "compiled_scene.hpp"
#include "dashpot/step/engine.hpp"

namespace {

constexpr int kContactCapacity = 2000;
constexpr int kBodies = 125;

// Bodies of every convex shape in stacks `spacing` (m) apart, one layer upon the other; every tenth
// on a joint.
std::string stacks(double spacing) {
  const char* geoms[] = {"type='sphere' size='.05'",
                         "type='box' size='.05 .04 .045'",
                         "type='capsule' size='.03 .03'",
                         "type='cylinder' size='.045 .045'",
                         "type='ellipsoid' size='.05 .04 .05'",
                         "type='mesh' mesh='wedge'"};
  std::string bodies;
  for (int i = 0; i < kBodies; ++i) {
    const auto at = [&](int place) { return std::to_string(spacing * place) + " "; };
    bodies += "<body pos='" + at(i % 5) + at(i / 5 % 5) + std::to_string(0.05 + 0.09 * (i / 25)) +
              "'>" + (i % 10 == 9 ? "<joint axis='1 .2 .3' damping='.01'/>" : "<freejoint/>") +
              "<geom condim='" + (i % 7 ? "3" : "6") + "' density='500' " + geoms[i % 6] +
              "/></body>";
  }
  return "<mujoco><option timestep='.002' cone='elliptic'/><size memory='20M'/><asset>"
         "<mesh name='wedge' vertex='0 0 0 .09 0 0 0 .09 0 0 0 .09 .06 .06 .06'/></asset>"
         "<worldbody><geom name='floor' type='plane' size='2 2 .1'/>" +
         bodies + "</worldbody></mujoco>";
}

bool have_same_state(const mjModel* m, const mjData* a, const mjData* b) {
  const auto same = [](const mjtNum* x, const mjtNum* y, mjtSize count) {
    return std::memcmp(x, y, count * sizeof(mjtNum)) == 0;
  };
  return same(a->qpos, b->qpos, m->nq) && same(a->qvel, b->qvel, m->nv) &&
         same(a->qfrc_constraint, b->qfrc_constraint, m->nv) &&
         same(a->userdata, b->userdata, m->nuserdata);
}

// One heap where stacks lean on each other, islands of their own where they do not.
void check_steps(double spacing) {
  mjModel* m = compile(stacks(spacing), kContactCapacity);
  dashpot::Parameters p;
  p.contact_capacity = kContactCapacity;
  p.geom_material.resize(m->ngeom);
  mjData* alone = mj_makeData(m);
  mjData* shared = mj_makeData(m);
  dashpot::Stepper one(m, p), several(m, p, 3);
  dashpot::StepStats stats;
  for (int step = 0; step < 150; ++step) {
    // The first steps of a stepper are shared, later ones where it pays.
    if (step % 50 == 0) several = dashpot::Stepper(m, p, 3);
    stats = one.step(alone);
    several.step(shared);
    check(have_same_state(m, alone, shared), "threads change no bit of a step");
  }
  check(stats.touching > 60, "bodies touch");
  mj_deleteData(alone);
  mj_deleteData(shared);
  mj_deleteModel(m);
}

}  // namespace

int main() {
  check_steps(0.095);
  check_steps(0.3);
  return exit_status();
}
