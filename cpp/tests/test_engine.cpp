// Runs the engine, rollouts and queries on one scene with bodies of every convex shape, a limited
// and an equality-constrained joint, dry friction and motors. Checks what must hold of them; run
// under the sanitizers it also shows that no step reads or writes outside its arrays or uses freed
// memory.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "compiled_scene.hpp"
#include "dashpot/detection/detection.hpp"
#include "dashpot/detection/geometry_host.hpp"
#include "dashpot/engine/contacts.hpp"
#include "dashpot/engine/engine.hpp"
#include "dashpot/geometry/closest.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/microsteps/microstep.hpp"
#include "dashpot/mujoco/errors.hpp"
#include "dashpot/mujoco/state.hpp"
#include "dashpot/simulations/rollout.hpp"

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

int failures = 0;

void check(bool passed, const char* claim) {
  if (passed) return;
  ++failures;
  std::printf("failed: %s\n", claim);
}

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
  dashpot::Rollouts(p).run(m, input, 1, one.data(), sensors.data());
  dashpot::Rollouts(p).run(m, input, 2, two.data(), sensors.data());
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

// Shapes over, beside and falling onto a height field of more than one block of cells.
void check_height_field() {
  std::vector<float> heights(40 * 30);
  for (float& height : heights) height = static_cast<float>(0.5 + 0.5 * random());
  dashpot::Shape field;
  field.type = dashpot::ShapeType::kHeightField;
  field.field.rows = 40;
  field.field.columns = 30;
  field.field.half_x = field.field.half_y = 1.0;
  field.field.elevation = 0.1;
  field.field.base = 0.2;
  field.field.heights = heights.data();
  dashpot::Shape box;
  box.type = dashpot::ShapeType::kBox;
  box.size << 0.1, 0.2, 0.3;
  for (int trial = 0; trial < 100; ++trial) {
    dashpot::Pose pose;
    pose.position << 2.0 * random(), 2.0 * random(), 0.8 + 0.2 * random();
    dashpot::Motion fall;
    fall.centre = pose.position;
    fall.linear.z() = -1.0;
    fall.angular << 0.0, 3.0 * random(), random();
    const double apart = dashpot::distance(field, {}, box, pose).distance;
    const auto impact = dashpot::time_of_impact(field, {}, {}, box, pose, fall, 1.0);
    const double then =
        dashpot::distance(field, {}, box, dashpot::advance(pose, fall, impact.time)).distance;
    check(apart > 0.0 && then > -1e-12, "a height field is not met late");
    check(!impact.hit || then < 1e-8, "a height field is met where it is");
    pose.position.z() = -0.2;
    const bool above = pose.position.head<2>().cwiseAbs().maxCoeff() < 1.0;
    check(!above || dashpot::distance(field, {}, box, pose).distance < 0.0,
          "what is in a height field overlaps it");
  }
}

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

// A contact whose stiffness is no number pushes nothing and says nothing by itself.
void check_forces_that_are_no_numbers() {
  dashpot::Trees trees;
  const int above[6] = {-1, 0, 1, 2, 3, 4};
  trees.append(0, 6, true, above);
  std::fill_n(trees.inverse.begin(), 3, 1.0);
  dashpot::Rows rows;
  rows.reset(1);
  dashpot::RowGroup& c = rows.append(dashpot::RowKind::kContact, 0, 1, {0, -1});
  c.pair = 0;
  dashpot::PairGeometry geometry;
  geometry.begin = {trees.tree[0].begin, 0};
  geometry.frame = {0, 0, 1, 1, 0, 0, 0, 1, 0};
  rows.pair.push_back(geometry);
  dashpot::find_inverse_mass(rows, c, trees);
  const int first = 0;
  dashpot::Island island;
  island.tree = island.group = {&first, &first + 1};
  island.microsteps = 16;
  island.duration = 1e-4;
  for (const double stiffness : {1e3, std::numeric_limits<double>::quiet_NaN()}) {
    dashpot::RowData data;
    data.reset_motion(trees.coordinates);
    data.reset_rows(rows);
    rows.stiffness[0] = stiffness;
    data.deformation[0] = -1e-3;
    bool thrown = false;
    try {
      dashpot::Team team(1);
      dashpot::MicrostepLoop(1).run(rows, trees, {island}, 0.1, 16e-4, data, team);
    } catch (const std::runtime_error&) {
      thrown = true;
    }
    check(thrown == std::isnan(stiffness), "forces that are no numbers are an error");
  }
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
  check_height_field();
  check_restored_middle();
  check_return_from_the_middle_without_room();
  check_prisms();
  check_forces_that_are_no_numbers();
  mj_deleteModel(m);
  if (failures) std::printf("%d checks failed\n", failures);
  return failures ? EXIT_FAILURE : EXIT_SUCCESS;
}
