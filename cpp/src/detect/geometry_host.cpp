#include "dashpot/detect/geometry_host.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

namespace {

// How far axes of a geom may be from orthonormal: single precision leaves 1e-7. Unset ones are 0.
constexpr double kOrthonormal = 1e-6;

// All but its label.
void set_field(const mjModel* model, int id, HeightField& field) {
  field.rows = model->hfield_nrow[id];
  field.columns = model->hfield_ncol[id];
  field.heights = model->hfield_data + model->hfield_adr[id];
  const double* size = model->hfield_size + 4 * id;
  field.half_x = size[0];
  field.half_y = size[1];
  field.elevation = size[2];
  field.base = size[3];
}

}  // namespace

host::HullVertices::HullVertices(const mjModel_* m, int mesh)
    : vertex_(m->mesh_vert + 3 * m->mesh_vertadr[mesh]), count_(m->mesh_vertnum[mesh]) {
  if (m->mesh_graphadr[mesh] < 0) return;
  // mesh_graph: numvert, numface, edge address per vertex, mesh vertex per hull vertex, ...
  const int* const graph = m->mesh_graph + m->mesh_graphadr[mesh];
  count_ = graph[0];
  of_hull_ = graph + 2 + count_;
}

Eigen::Matrix3Xd hull_vertices(const mjModel* model, int mesh) {
  const host::HullVertices hull(model, mesh);
  Eigen::Matrix3Xd vertices(3, hull.count());
  for (int i = 0; i < hull.count(); ++i) vertices.col(i) = hull.at(i);
  return vertices;
}

HeightField height_field(const mjModel* model, int id) {
  HeightField field;
  set_field(model, id, field);
  return field;
}

Shape geom_shape(const mjModel* model, int geom) {
  const std::string label = host::contact_side(model, geom);
  const double* size = model->geom_size + 3 * geom;
  Shape shape;
  shape.size << size[0], size[1], size[2];
  switch (model->geom_type[geom]) {
    case mjGEOM_PLANE:
      shape.type = ShapeType::kPlane;
      break;
    case mjGEOM_SPHERE:
      shape.type = ShapeType::kSphere;
      break;
    case mjGEOM_CAPSULE:
      shape.type = ShapeType::kCapsule;
      break;
    case mjGEOM_CYLINDER:
      shape.type = ShapeType::kCylinder;
      break;
    case mjGEOM_ELLIPSOID:
      shape.type = ShapeType::kEllipsoid;
      break;
    case mjGEOM_BOX:
      shape.type = ShapeType::kBox;
      break;
    case mjGEOM_MESH:
      shape.type = ShapeType::kHull;
      shape.hull = std::make_shared<const Hull>(hull_vertices(model, model->geom_dataid[geom]));
      break;
    case mjGEOM_HFIELD:
      shape.type = ShapeType::kHeightField;
      shape.field = height_field(model, model->geom_dataid[geom]);
      shape.field.label = label;
      break;
    case mjGEOM_SDF:
      throw std::invalid_argument(label +
                                  " is a signed distance field, which queries do not cover");
    default:
      throw std::invalid_argument(label + " has type " + std::to_string(model->geom_type[geom]) +
                                  ", which queries do not cover");
  }
  check_shape(shape, label.c_str());
  return shape;
}

Pose unchecked_geom_pose(const mjData* data, int geom) {
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  return {Eigen::Map<const Eigen::Vector3d>(data->geom_xpos + 3 * geom),
          Eigen::Map<const RowMajor>(data->geom_xmat + 9 * geom)};
}

Pose geom_pose(const mjModel* model, const mjData* data, int geom) {
  const Pose pose = unchecked_geom_pose(data, geom);
  if (!pose.position.allFinite()) {
    throw std::invalid_argument("geom_xpos of " + host::contact_side(model, geom) +
                                " is not finite");
  }
  const Eigen::Matrix3d gram = pose.rotation.transpose() * pose.rotation;
  if (!gram.isIdentity(kOrthonormal)) {
    throw std::invalid_argument("geom_xmat of " + host::contact_side(model, geom) +
                                " is not a rotation; call mujoco.mj_forward first");
  }
  return pose;
}

Motion geom_motion(const mjModel* model, const mjData* data, int geom) {
  const int body = model->geom_bodyid[geom];
  double velocity[6];  // angular, linear
  mj_objectVelocity(model, data, mjOBJ_BODY, body, velocity, 0);
  const Eigen::Map<const Eigen::Vector3d> own_centre(data->xipos + 3 * body);
  Motion motion;
  motion.centre = Eigen::Map<const Eigen::Vector3d>(host::centre_of_motion(model, data, body));
  motion.angular = Eigen::Map<const Eigen::Vector3d>(velocity);
  motion.linear = Eigen::Map<const Eigen::Vector3d>(velocity + 3) +
                  motion.angular.cross(motion.centre - own_centre);
  if (!motion.centre.allFinite() || !motion.angular.allFinite() || !motion.linear.allFinite()) {
    throw std::invalid_argument("the velocity of the body of " + host::contact_side(model, geom) +
                                " is not finite");
  }
  return motion;
}

bool has_shape(const mjModel* model, int geom) { return model->geom_type[geom] != mjGEOM_SDF; }

const Shape& GeomShapes::of(const mjModel* model, int geom) {
  shape_.resize(model->ngeom);
  Known& known = shape_[geom];
  const int type = model->geom_type[geom], data = model->geom_dataid[geom];
  if (type != known.type || data != known.data) known = {geom_shape(model, geom), type, data};
  Shape& shape = known.shape;
  shape.size = Eigen::Map<const Eigen::Vector3d>(model->geom_size + 3 * geom);
  if (type == mjGEOM_HFIELD) set_field(model, data, shape.field);
  return shape;
}

GeomBounds geom_bounds(const mjModel* model, int geom) {
  const mjtNum* size = model->geom_size + 3 * geom;
  const mjtNum* half = model->geom_aabb + 6 * geom + 3;
  switch (model->geom_type[geom]) {
    case mjGEOM_PLANE:
      return {std::numeric_limits<double>::infinity(), 0.0, false, false};
    case mjGEOM_SPHERE:
      return {size[0], 0.0, true, true};
    case mjGEOM_CAPSULE:
      return {size[0], size[1], true, true};
    case mjGEOM_CYLINDER:
      return {std::min(size[0], size[1]), std::hypot(size[0], size[1]), true, false};
    case mjGEOM_ELLIPSOID:
      return {std::min({size[0], size[1], size[2]}), std::max({size[0], size[1], size[2]}),
              size[0] == size[1], true};
    case mjGEOM_BOX:
      return {std::min({size[0], size[1], size[2]}), mju_norm3(size), false, false};
    default:
      return {std::min({half[0], half[1], half[2]}), model->geom_rbound[geom], false, false};
  }
}

Motion body_motion(const mjModel* model, const mjData* data, int body, const double* spatial) {
  const Eigen::Map<const Eigen::Vector3d> about(data->subtree_com + 3 * model->body_rootid[body]);
  Motion motion;
  motion.centre = Eigen::Map<const Eigen::Vector3d>(host::centre_of_motion(model, data, body));
  motion.angular = Eigen::Map<const Eigen::Vector3d>(spatial);
  motion.linear =
      Eigen::Map<const Eigen::Vector3d>(spatial + 3) + motion.angular.cross(motion.centre - about);
  return motion;
}

std::vector<Motion> body_motions(const mjModel* model, const mjData* data, const double* qvel) {
  std::vector<double> spatial;
  host::body_velocities(model, data, qvel, spatial);
  std::vector<Motion> motions(model->nbody);
  for (int body = 0; body < model->nbody; ++body)
    motions[body] = body_motion(model, data, body, spatial.data() + 6 * body);
  return motions;
}

int geom_body(const mjModel* model, int geom) { return model->geom_bodyid[geom]; }

double geom_offset(const mjData* data, int geom, const Eigen::Vector3d& point) {
  return (Eigen::Map<const Eigen::Vector3d>(data->geom_xpos + 3 * geom) - point).norm();
}

std::vector<PlacedShape> placed_shapes(const mjModel* model, const mjData* data, int body) {
  std::vector<PlacedShape> shapes;
  for (int geom = 0; geom < model->ngeom; ++geom) {
    if (model->geom_contype[geom] == 0 && model->geom_conaffinity[geom] == 0) continue;
    const int owner = model->geom_bodyid[geom];
    shapes.push_back({geom_shape(model, geom), geom_pose(model, data, geom), geom,
                      model->body_weldid[owner], body < 0 || owner == body});
  }
  return shapes;
}

}  // namespace dashpot
