// The state in mjData: positions and velocities of trees, contact memory, substeps; and models and
// data that are made here.

#pragma once

#include <memory>
#include <vector>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/rows/free_body.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

const double* position(const mjData_* d);
const double* velocity(const mjData_* d);

// `acceleration` is the smooth generalized acceleration of the tree; `parts` are those of a body
// that has_welded_parts, null of all others.
FreeBody read_free_body(const mjModel_* m, const mjData_* d, int tree, const WeldedParts* parts,
                        const double* acceleration);
Eigen::Quaterniond orientation(const mjModel_* m, const mjData_* d, int tree);
void write_free_body(const mjModel_* m, mjData_* d, int tree, const FreeBody& body);

void set_velocity(mjData_* d, const std::vector<double>& velocity);  // (nv)
// Adds `change` to the velocity of one tree; one entry per degree of freedom of it.
void add_velocity(mjData_* d, const Tree& tree, const double* change);
// Replaces the state of one tree by `velocity`, and by positions moved from `start_position` (nq)
// by `displacement`; both are generalized, one entry per degree of freedom of the tree.
void write_tree(const mjModel_* m, mjData_* d, const Tree& tree, const double* start_position,
                const double* displacement, const double* velocity);

// Copies everything that steps go on from.
void copy_state(const mjModel_* m, const mjData_* d, mjData_* to);

// Contact memory lives behind the model's own user data: `size` doubles.
void reserve_memory(mjModel_* m, int size);
double* memory(const mjModel_* m, mjData_* d, int size);

// A model for one worker, without a copy of all that it holds.
//
// A step changes options and detection distances of its model for a while (Substeps and
// detect/reach.hpp). A view has these of its own and shares the rest, meshes above all, which no
// step writes to: views of one model step side by side.
class ModelView {
 public:
  // Of the model as it is now; `model` must outlive the view, and what is shared stays unchanged.
  explicit ModelView(const mjModel_* model);
  ModelView(ModelView&&) noexcept;
  ~ModelView();
  // Takes the values that the model, or another of its sizes, has now; get() stays.
  void update(const mjModel_* model);
  mjModel_* get() const { return view_.get(); }

 private:
  std::unique_ptr<mjModel_> view_;
  std::vector<double> own_;
};

struct DataDeleter {
  void operator()(mjData_* d) const;
};
using OwnedData = std::unique_ptr<mjData_, DataDeleter>;

// Throws MujocoError where there is no memory for them.
OwnedData make_data(const mjModel_* m);

// A step that may be taken in substeps. Where it was, the model's time step is restored at its end,
// and time has advanced by that step or, without finish(), the state at the start is back but for
// poses of mocap bodies (mocap_motion.hpp).
class Substeps {
 public:
  Substeps(mjModel_* m, mjData_* d);
  ~Substeps();
  Substeps(const Substeps&) = delete;
  Substeps& operator=(const Substeps&) = delete;

  double whole() const { return timestep_; }  // s
  bool cut() const { return !start_.empty(); }
  void set_length(double length);  // of the substep, s; the first call cuts the step
  // The buffers of delayed controls and sensors have one sample of a step, that of its start.
  void end_substep();
  void finish() { finished_ = true; }

 private:
  mjModel_* model_;
  mjData_* data_;
  double timestep_, end_;
  bool finished_ = false;
  std::vector<double> start_, history_;
};

}  // namespace dashpot::host
