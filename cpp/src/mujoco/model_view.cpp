#include "dashpot/mujoco/model_view.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstddef>

namespace dashpot::host {

namespace {

struct Array {
  mjtNum* mjModel::*values;
  std::size_t count;
};

// What WidenedReach changes.
std::vector<Array> detection_distances(const mjModel* m) {
  const auto size = [](auto count) { return static_cast<std::size_t>(count); };
  return {{&mjModel::geom_gap, size(m->ngeom)},  {&mjModel::body_margin, size(m->nbody)},
          {&mjModel::pair_gap, size(m->npair)},  {&mjModel::flex_gap, size(m->nflex)},
          {&mjModel::jnt_margin, size(m->njnt)}, {&mjModel::tendon_margin, size(m->ntendon)}};
}

}  // namespace

ModelView::ModelView(const mjModel* model) : view_(std::make_unique<mjModel>()) { update(model); }

ModelView::ModelView(ModelView&&) noexcept = default;

ModelView::~ModelView() = default;

void ModelView::update(const mjModel* model) {
  *view_ = *model;
  const std::vector<Array> arrays = detection_distances(model);
  std::size_t total = 0;
  for (const Array& array : arrays) total += array.count;
  own_.resize(total);
  double* next = own_.data();
  for (const Array& array : arrays) {
    std::copy_n(model->*array.values, array.count, next);
    view_.get()->*array.values = next;
    next += array.count;
  }
}

}  // namespace dashpot::host
