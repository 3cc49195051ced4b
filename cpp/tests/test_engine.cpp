// Runs the engine, rollouts and queries on one scene with bodies of every convex shape, a limited
// and an equality-constrained joint, dry friction and motors. Checks what must hold of them; run
// under the sanitizers it also shows that no step reads or writes outside its arrays or uses freed
// memory.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "checks.hpp"
#include "compiled_scene.hpp"
#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/simulations/rollout.hpp"
#include "dashpot/step/contacts.hpp"
#include "dashpot/step/engine.hpp"

namespace {

long allocations = 0;  // by operator new, so not MuJoCo's

void* allocate(std::size_t size, std::size_t alignment) {
  ++allocations;
  const std::size_t whole =
      (std::max<std::size_t>(size, 1) + alignment - 1) / alignment * alignment;
  if (void* memory = std::aligned_alloc(alignment, whole)) return memory;
  throw std::bad_alloc();
}

}  // namespace

void* operator new(std::size_t size) { return allocate(size, alignof(std::max_align_t)); }
void* operator new(std::size_t size, std::align_val_t alignment) {
  return allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

namespace {

constexpr int kContactCapacity = 400;

std::string scene() {
  const char* geoms[] = {"type='sphere' size='.05'",
                         "type='box' size='.05 .04 .06'",
                         "type='capsule' size='.03 .05'",
                         "type='cylinder' size='.04 .05'",
                         "type='ellipsoid' size='.05 .04 .06'",
                         "type='mesh' mesh='wedge'"};
  std::string bodies;
  for (int i = 0; i < 12; ++i) {
    bodies += "<body pos='" + std::to_string(0.07 * (i % 3)) + " " +
              std::to_string(0.06 * (i % 2)) + " " + std::to_string(0.1 + 0.12 * i) +
              "'><freejoint/><geom condim='" + std::string(i % 2 ? "3" : "6") + "' density='500' " +
              geoms[i % 6] + "/></body>";
  }
  return "<mujoco><option timestep='.004' cone='elliptic' integrator='implicitfast'/><asset>"
         "<mesh name='wedge' vertex='0 0 0 .1 0 0 0 .1 0 0 0 .1'/></asset><worldbody>"
         "<geom name='floor' type='plane' size='2 2 .1'/>" +
         bodies +
         "<body pos='.5 0 .4'><joint name='shoulder' axis='0 1 0' range='-60 60' limited='true' "
         "damping='.1'/><geom type='capsule' fromto='0 0 0 .2 0 0' size='.03'/>"
         "<body pos='.2 0 0'><joint name='elbow' axis='0 1 0' frictionloss='.05'/>"
         "<geom type='capsule' fromto='0 0 0 .2 0 0' size='.03'/></body></body>"
         "<body pos='1 0 .4'><joint name='follower' axis='0 1 0'/>"
         "<geom type='box' pos='.1 0 0' size='.1 .02 .02'/></body>"
         "<body pos='1.5 0 .6'><joint type='ball' range='0 40' limited='true'/>"
         "<geom type='capsule' fromto='0 0 0 .2 .1 0' size='.03'/></body></worldbody>"
         "<equality><joint joint1='follower' joint2='shoulder'/></equality>"
         "<actuator><motor joint='shoulder' gear='2'/></actuator></mujoco>";
}

dashpot::Parameters parameters(const mjModel* m) {
  dashpot::Parameters result;
  result.contact_capacity = kContactCapacity;
  result.geom_material.resize(m->ngeom);
  for (int geom = 0; geom < m->ngeom; geom += 2) {
    dashpot::Material& material = result.geom_material[geom];
    material.rigid = false;
    material.stiffness = 1e4 * (1 + geom);
    material.form = dashpot::DampingForm::kRestitution;
    material.damping = 0.3;
  }
  dashpot::Material pair;
  pair.rigid = false;
  pair.stiffness = 1e6;
  pair.has_friction = true;
  result.pair_material[{0, 1}] = pair;
  return result;
}

// Steps until the bodies lie on the floor, with readable reports on the way.
void check_steps(mjModel* m, const dashpot::Parameters& p) {
  mjData* d = mj_makeData(m);
  dashpot::Stepper stepper(m, p);
  int touching = 0;
  for (int step = 0; step < 500; ++step) {
    d->ctrl[0] = std::sin(0.02 * step);
    const dashpot::StepStats stats = stepper.step(d);
    touching = std::max(touching, stats.touching);
    const dashpot::ContactReport report = dashpot::report_contacts(m, d, kContactCapacity);
    for (std::size_t c = 0; c < report.force.size(); ++c) {
      check(report.force[c][0] >= 0.0, "a contact never pulls");
      check(report.compression[c] >= 0.0, "a spring is never longer than its rest length");
    }
  }
  check(touching >= 12, "every body comes to touch something");
  double lowest = 1.0;
  double fastest = 0.0;
  for (int body = 1; body < m->nbody; ++body) lowest = std::min(lowest, d->xipos[3 * body + 2]);
  for (int dof = 0; dof < m->nv; ++dof) fastest = std::max(fastest, std::fabs(d->qvel[dof]));
  check(lowest > 0.0, "no body sinks through the floor");
  check(fastest < 50.0, "velocities stay those of a fall from 1.5 m");

  const double speed = d->qvel[0];
  d->qvel[0] = std::numeric_limits<double>::quiet_NaN();
  bool refused = false;
  try {
    stepper.step(d);
  } catch (const std::invalid_argument&) {
    refused = true;
  }
  check(refused, "a state that is not finite is refused");
  d->qvel[0] = speed;
  mj_deleteData(d);
}

// A step allocates nothing once its arrays are as large as the scene asks for.
void check_allocations(mjModel* m, const dashpot::Parameters& p) {
  mjData* d = mj_makeData(m);
  dashpot::Stepper stepper(m, p);
  for (int pass = 0; pass < 2; ++pass) {
    mj_resetData(m, d);
    const long before = allocations;
    stepper.step(d, 400);
    if (pass == 1) check(allocations == before, "a step that was taken before allocates nothing");
  }
  mj_deleteData(d);
}

// Many rollouts give the same bits on one thread and on two.
void check_rollouts(const mjModel* m, const dashpot::Parameters& p) {
  const dashpot::ModelSizes sizes = dashpot::sizes_of(m);
  const int nbatch = 5, nstep = 60;
  std::vector<double> initial;
  std::mt19937 random(1);
  mjData* d = mj_makeData(m);
  for (int i = 0; i < nbatch; ++i) {
    mj_resetData(m, d);
    for (int dof = 0; dof < m->nv; ++dof) d->qvel[dof] = 1e-9 * random() - 2.0;
    std::vector<double> state(sizes.full_physics);
    mj_getState(m, d, state.data(), mjSTATE_FULLPHYSICS);
    initial.insert(initial.end(), state.begin(), state.end());
  }
  mj_deleteData(d);
  dashpot::RolloutInput input;
  input.nbatch = nbatch;
  input.nstep = nstep;
  input.initial_state = initial.data();
  std::vector<double> one(nbatch * nstep * sizes.full_physics), two(one.size());
  std::vector<double> sensors(nbatch * nstep * sizes.nsensordata);
  dashpot::SimulationPool simulations(p);
  dashpot::RolloutOutput output;
  output.sensordata = sensors.data();
  for (const int threads : {1, 2}) {
    output.state = (threads == 1 ? one : two).data();
    dashpot::roll_out({{m, &simulations}}, input, output, threads);
  }
  check(std::memcmp(one.data(), two.data(), one.size() * sizeof(double)) == 0,
        "rollouts do not depend on the number of threads");
}

// The pairs within a radius are those that a search over all pairs finds.
void check_queries(const mjModel* m) {
  mjData* d = mj_makeData(m);
  mj_forward(m, d);
  const std::vector<dashpot::PlacedShape> shapes = dashpot::placed_shapes(m, d, -1);
  const double radius = 0.1;
  std::size_t expected = 0;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    for (std::size_t j = i + 1; j < shapes.size(); ++j) {
      if (shapes[i].group == shapes[j].group) continue;
      const double distance =
          dashpot::distance(shapes[i].shape, shapes[i].pose, shapes[j].shape, shapes[j].pose)
              .distance;
      if (distance <= radius) ++expected;
      const dashpot::TimeOfImpact impact = dashpot::time_of_impact(
          shapes[i].shape, shapes[i].pose, dashpot::geom_motion(m, d, shapes[i].geom),
          shapes[j].shape, shapes[j].pose, dashpot::geom_motion(m, d, shapes[j].geom), 1.0);
      // Nothing moves, so that only what touches at once ever touches.
      check(impact.hit == (distance <= 1e-9), "bodies at rest do not come to touch");
    }
  }
  const auto pairs = dashpot::closest_pairs(shapes, radius);
  check(expected > 10 && pairs.size() == expected, "close pairs are found, and no others");
  mj_deleteData(d);
}

// Prisms on top of each other: with more sides than faces keep corners, or with more points than
// MuJoCo has room for.
std::string stack_of_prisms(int sides, const std::string& memory) {
  std::string vertices, bodies;
  for (int i = 0; i < 2 * sides; ++i) {
    const double angle = 2.0 * std::acos(-1.0) * (i / 2) / sides;
    vertices += std::to_string(.1 * std::cos(angle)) + " " + std::to_string(.1 * std::sin(angle)) +
                (i % 2 ? " .05 " : " -.05 ");
  }
  for (int i = 0; i < 4; ++i)
    bodies += "<body pos='0 0 " + std::to_string(.051 + .102 * i) + "' euler='0 0 " +
              std::to_string(10 * i) +
              "'><freejoint/><geom type='mesh' mesh='prism' density='500'/></body>";
  return "<mujoco>" + memory +
         "<option timestep='.002' cone='elliptic'/><asset><mesh name='prism' vertex='" + vertices +
         "'/></asset><worldbody><geom type='plane' size='9 9 .1'/><geom type='box' "
         "size='.1 .1 .05' pos='1 0 .05'/><body pos='1 0 .151'><freejoint/><geom type='mesh' "
         "mesh='prism' density='500'/></body>" +
         bodies + "</worldbody></mujoco>";
}

void check_prisms() {
  for (const int sides : {3, 8, 100}) {
    mjModel* m = compile(stack_of_prisms(sides, ""), kContactCapacity);
    dashpot::Parameters p;
    p.contact_capacity = kContactCapacity;
    p.geom_material.resize(m->ngeom);
    check_allocations(m, p);
    mjData* d = mj_makeData(m);
    dashpot::Stepper stepper(m, p);
    stepper.step(d, 500);
    int most = 0, count = 0;
    bool together = true;
    for (int i = 0; i < d->ncon; ++i) {
      const int* const geom = d->contact[i].geom;
      const bool goes_on = i > 0 && std::equal(geom, geom + 2, d->contact[i - 1].geom);
      count = goes_on ? count + 1 : 1;
      most = std::max(most, count);
      for (int j = 0; j + 1 < i && !goes_on; ++j)
        together = together && !std::equal(geom, geom + 2, d->contact[j].geom);
    }
    check(together, "contacts of a pair stay together");
    check(most > 4 || sides == 3, "faces give more points than MuJoCo has room for");
    check(most <= 26, "faces of many corners keep some of them");
    mj_deleteData(d);
    mj_deleteModel(m);
  }
  mjModel* m = compile(stack_of_prisms(8, "<size memory='40000'/>"), kContactCapacity);
  mjData* d = mj_makeData(m);
  dashpot::Parameters p;
  p.contact_capacity = kContactCapacity;
  p.geom_material.resize(m->ngeom);
  dashpot::Stepper stepper(m, p);
  bool thrown = false;
  try {
    stepper.step(d, 500);
  } catch (const std::runtime_error&) {
    thrown = true;
  }
  check(thrown, "contacts that do not fit into the memory of the model are an error");
  mj_deleteData(d);
  mj_deleteModel(m);
}

}  // namespace

int main() {
  mjModel* m = compile(scene(), kContactCapacity);
  const dashpot::Parameters p = parameters(m);
  for (const int integrator : {mjINT_EULER, mjINT_RK4, mjINT_IMPLICIT, mjINT_IMPLICITFAST}) {
    m->opt.integrator = integrator;
    check_steps(m, p);
    check_allocations(m, p);
    check_rollouts(m, p);
  }
  check_queries(m);
  check_prisms();
  mj_deleteModel(m);
  return exit_status();
}
