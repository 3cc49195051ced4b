#include "dashpot/model/jacobians.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

namespace {

using Eigen::Map;
using Eigen::Vector3d;

constexpr int kBodyRows = 6;  // coordinates of a free body that are not zero

bool is_on_moving_mocap(const mjModel* m, const mjData* d, int geom) {
  if (geom < 0) return false;
  const mjtNum* twist = mocap_twist(m, d, m->geom_bodyid[geom]);
  return twist && is_moving(twist);
}

// Whether the surface of a side moves by itself, as belts and mocap bodies do.
bool is_driven(const mjModel* m, const mjData* d, const ContactInput& input) {
  return has_surface_motion(m, input) || input.surface_acceleration != std::array<double, 3>{} ||
         is_on_moving_mocap(m, d, input.geom[0]) || is_on_moving_mocap(m, d, input.geom[1]);
}

// Adds what mocap bodies add to the rates of a contact's rows by their motion.
void add_mocap_motion(const mjModel* m, const mjData* d, const ContactInput& input,
                      std::array<double, 6>& rate) {
  const double* frame = input.frame.data();
  for (int side = 0; side < 2; ++side) {
    if (!is_on_moving_mocap(m, d, input.geom[side])) continue;
    const int body = m->geom_bodyid[input.geom[side]];
    mjtNum twist[6], velocity[3];
    mocap_twist_ahead(m, d, body, input.ahead, twist);
    velocity_of_point(m, d, body, twist, input.acting_point(side).data(), velocity);
    const double sign = side ? 1.0 : -1.0;
    for (int i = 0; i < 3; ++i) {
      rate[i] += sign * mju_dot3(frame + 3 * i, velocity);
      rate[3 + i] += sign * mju_dot3(frame + 3 * i, twist);
    }
  }
}

// What the own motion of its surfaces adds to the rate of each row of a contact, at the time at
// which its geometry is frozen. Mocap bodies have the velocity of cvel in the middle of the part,
// which is as long as the timestep.
std::array<double, 6> surface_rate(const mjModel* m, const mjData* d, const ContactInput& input) {
  std::array<double, 6> rate = surface_motion(m, d, input);
  add_mocap_motion(m, d, input, rate);
  const std::array<double, 3> acceleration = along_frame(input, input.surface_acceleration);
  for (int i = 0; i < 3; ++i) rate[i] += (input.ahead - 0.5 * m->opt.timestep) * acceleration[i];
  return rate;
}

// Appends the coordinates of a tree that move either geom of a contact; returns how many.
int append_columns_of(const mjModel* m, const ContactInput& input, const Tree& t, int tree,
                      Rows& rows) {
  const size_t before = rows.column.size();
  if (t.free_body) {
    for (int i : {0, 1, 2, 4, 5, 6}) rows.column.push_back(t.begin + i);
    return kBodyRows;
  }
  // Both chains from the leaves down, merged; each descends strictly.
  int dof[2] = {-1, -1};
  for (int side = 0; side < 2; ++side)
    if (input.tree[side] == tree) dof[side] = last_dof(m, m->geom_bodyid[input.geom[side]]);
  while (dof[0] >= 0 || dof[1] >= 0) {
    const int next = std::max(dof[0], dof[1]);
    rows.column.push_back(t.begin + next - t.dof_begin);
    for (int& end : dof)
      if (end == next) end = m->dof_parentid[end];
  }
  std::reverse(rows.column.begin() + before, rows.column.end());
  return static_cast<int>(rows.column.size() - before);
}

// Adds what the body on one side contributes to the sparse rows of a contact.
void add_side(const mjModel* m, const mjData* d, const ContactInput& input, int side,
              const PairGeometry& pair, const Trees& trees, const RowGroup& c, Rows& rows) {
  const int block = c.tree[0] == input.tree[side] ? 0 : 1;
  const Tree& t = trees.tree[input.tree[side]];
  const int first = block == 0 ? 0 : c.columns[0];
  const int* column = rows.column.data() + c.column + first;
  double* value = rows.value.data() + c.value + first;
  if (t.free_body) {
    for (int i = 0; i < c.dim; ++i) {
      const std::array<double, 6> row = pair_row(pair, i, side);
      for (int k = 0; k < kBodyRows; ++k) value[i * c.width() + k] = row[k];
    }
    return;
  }
  const double sign = side ? 1.0 : -1.0;
  const int body = m->geom_bodyid[input.geom[side]], width = c.width();
  const std::array<double, 3> point = input.acting_point(side);
  const Vector3d arm = Map<const Vector3d>(point.data()) -
                       Map<const Vector3d>(d->subtree_com + 3 * m->body_rootid[body]);
  int k = c.columns[block] - 1;
  for (int dof = last_dof(m, body); dof >= 0; dof = m->dof_parentid[dof]) {
    while (column[k] != t.begin + dof - t.dof_begin) --k;
    mjtNum axis[6];
    axis_ahead(m, d, dof, input.ahead, axis);
    const Map<const Vector3d> angular(axis), of_origin(axis + 3);
    const Vector3d linear = angular.cross(arm) + of_origin;
    for (int i = 0; i < c.dim; ++i) {
      const Map<const Vector3d> direction(input.frame.data() + 3 * (i % 3));
      value[i * width + k] += sign * (i < 3 ? direction.dot(linear) : direction.dot(angular));
    }
  }
}

}  // namespace

bool has_pair_geometry(const mjModel_* m, const mjData_* d, const ContactInput& input,
                       const Trees& trees) {
  if (input.is_of_flex() || input.tree[0] == input.tree[1] || is_driven(m, d, input)) return false;
  return std::all_of(input.tree.begin(), input.tree.end(),
                     [&](int tree) { return tree < 0 || trees.tree[tree].free_body; });
}

PairGeometry pair_geometry(const mjModel_* m, const mjData_* d, const ContactInput& input,
                           const Trees& trees) {
  PairGeometry pair;
  pair.frame = input.frame;
  for (int side = 0; side < 2; ++side) {
    const int tree = input.tree[side];
    if (tree < 0) continue;
    pair.begin[side] = trees.tree[tree].begin;
    const mjtNum* centre = centre_of_motion(m, d, m->geom_bodyid[input.geom[side]]);
    const std::array<double, 3> point = input.acting_point(side);
    for (int i = 0; i < 3; ++i) pair.arm[side][i] = point[i] - centre[i];
  }
  return pair;
}

void append_columns(const mjModel_* m, const mjData_* d, const ContactInput& input,
                    const Trees& trees, Rows& rows) {
  RowGroup& c = rows.group.back();
  const bool driven = is_driven(m, d, input);
  if (input.is_of_flex()) {
    append_rows(m, d, d->contact[input.source].efc_address, trees, rows);
    if (driven) append_ground_motion(rows, kSurfaceCoordinate, surface_rate(m, d, input).data());
    return;
  }
  for (int block = 0; block < 2; ++block)
    if (c.tree[block] >= 0)
      c.columns[block] =
          append_columns_of(m, input, trees.tree[c.tree[block]], c.tree[block], rows);
  if (driven) {
    c.ground = kSurfaceCoordinate;
    rows.on_surface.push_back(static_cast<int>(rows.group.size()) - 1);
    rows.column.push_back(kSurfaceCoordinate);
  }
  rows.value.resize(c.value + c.dim * c.width(), 0.0);
}

void fill_jacobian(const mjModel_* m, const mjData_* d, const ContactInput& input,
                   const Trees& trees, const RowGroup& c, Rows& rows) {
  if (input.is_of_flex()) return;
  const PairGeometry pair = pair_geometry(m, d, input, trees);
  for (int side = 0; side < 2; ++side)
    if (input.tree[side] >= 0) add_side(m, d, input, side, pair, trees, c, rows);
  if (c.ground < 0) return;
  const std::array<double, 6> rate = surface_rate(m, d, input);
  for (int i = 0; i < c.dim; ++i) rows.value[c.value + (i + 1) * c.width() - 1] = rate[i];
}

double typical_inverse_mass(const mjModel_* m, const mjData_* d, const ContactInput& input) {
  if (input.is_of_flex()) return d->efc_diagA[d->contact[input.source].efc_address];
  return m->body_invweight0[2 * m->geom_bodyid[input.geom[0]]] +
         m->body_invweight0[2 * m->geom_bodyid[input.geom[1]]];
}

void typical_inverse_masses(const mjModel_* m, const mjData_* d, const ContactInput& input,
                            const std::array<double, 5>& friction, double* typical) {
  if (input.is_of_flex()) {
    std::copy_n(d->efc_diagA + d->contact[input.source].efc_address, input.dim, typical);
    return;
  }
  // MuJoCo's efc_diagA at an impratio of 1, computed here because its rows may be left out:
  // friction rows are regularised by their part of the limit surface.
  typical[0] = typical_inverse_mass(m, d, input);
  for (int i = 1; i < input.dim; ++i) {
    const double ratio = std::max(friction[0], mjMINMU) / std::max(friction[i - 1], mjMINMU);
    typical[i] = typical[0] * ratio * ratio;
  }
}

}  // namespace dashpot::host
